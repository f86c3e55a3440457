"""Place recognition (chapter 3): network, module, comparison and report."""

"""Place recognition by appearance-invariant descriptors (chapter 3), and the place maps made of them."""

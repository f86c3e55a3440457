"""Image classification, and push-pull inhibition against corruptions (chapter 7)."""

"""``predict.py`` with a model of classification, or of recognition by COSFIRE filters: what each image shows."""

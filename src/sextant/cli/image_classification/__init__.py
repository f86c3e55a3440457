"""``predict.py`` with a model of classification or of recognition by COSFIRE filters: the class of each image."""

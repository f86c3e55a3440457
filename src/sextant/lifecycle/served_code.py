"""The code of a registered model: MLflow keeps a copy of this file with it, and runs it where the model is loaded."""

from sextant.recipes.photo_predictors import photo_predictor
from sextant.tracking.registry import serve

serve(photo_predictor)

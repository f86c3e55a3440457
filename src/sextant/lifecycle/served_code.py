"""The code of a registered model. MLflow keeps a copy of this file with the model and runs it on loading."""

from sextant.lifecycle.offered import photo_predictor
from sextant.tracking.registry import serve

serve(photo_predictor)

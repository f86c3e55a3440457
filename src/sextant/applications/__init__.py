"""What a person does with a trained model: calibrate photos, recognise places, localize, detect, classify."""

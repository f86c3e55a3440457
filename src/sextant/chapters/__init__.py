"""What a person trains, sweeps and predicts with: one package for each chapter of methods, all with one face."""

"""The foundation of all chapters: their interface, and reading, building and serving of trained models."""

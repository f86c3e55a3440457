"""What every chapter builds on: its interface, and what reads, builds and serves trained models."""

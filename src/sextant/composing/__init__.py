"""Composing configs from YAML files and overrides; only this package and the command line use Hydra."""

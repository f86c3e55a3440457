"""Composing configs of YAML files and overrides; the only place beside the command line that knows Hydra."""

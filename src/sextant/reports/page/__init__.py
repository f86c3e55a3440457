"""Reports as self-contained pages that need no server and no network."""

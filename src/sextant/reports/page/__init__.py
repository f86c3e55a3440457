"""Reports as single pages that need no server and no network."""

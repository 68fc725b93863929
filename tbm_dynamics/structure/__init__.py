"""Elements and their assembly."""

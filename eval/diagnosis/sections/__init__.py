"""The sections of a diagnosis, one module each."""

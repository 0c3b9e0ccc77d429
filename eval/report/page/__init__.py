"""The page: one HTML file that opens offline, one module for each part."""

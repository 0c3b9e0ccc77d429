"""An export as Parquet: the files as they are, with a Croissant description and a data card."""

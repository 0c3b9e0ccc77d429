"""Evidence: one record per episode, stored in Parquet."""

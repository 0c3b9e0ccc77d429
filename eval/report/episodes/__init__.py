"""Single episodes for the page: every outcome, some traces, the picture of the task; packed."""

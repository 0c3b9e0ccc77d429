"""What can go wrong with evidence that is read or written."""


class EvidenceError(ValueError):
    """One sentence that says what is wrong with the evidence and what helps."""


class BatchExistsError(EvidenceError):
    """A batch of that name has already been committed."""

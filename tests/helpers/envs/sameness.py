"""Whether nested values of two environments are the same."""

from __future__ import annotations

import numpy as np


def assert_same(ours, sync, path="info"):
    """Values of ours are those of Gymnasium's `SyncVectorEnv`, of the same types."""
    assert type(ours) is type(sync) or np.isscalar(ours), path
    if isinstance(sync, dict):
        assert ours.keys() == sync.keys(), path
        for key in sync:
            assert_same(ours[key], sync[key], f"{path}[{key}]")
    elif isinstance(sync, np.ndarray) and sync.dtype == object:
        for a, b in zip(ours, sync, strict=True):
            np.testing.assert_equal(a, b, err_msg=path)
    else:
        assert ours.dtype == sync.dtype, path
        np.testing.assert_allclose(ours, sync, rtol=1e-12, atol=1e-12, err_msg=path)

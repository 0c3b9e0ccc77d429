"""Whether nested values of two environments are the same."""

from __future__ import annotations

import numpy as np


def assert_same(found, expected, rtol=0.0, path="info"):
    """Values are those of the other environment, and arrays of the same types."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys(), path
        for key in expected:
            assert_same(found[key], expected[key], rtol, f"{path}[{key}]")
    elif isinstance(expected, (tuple, list)):
        for place, (one, other) in enumerate(zip(found, expected, strict=True)):
            assert_same(one, other, rtol, f"{path}[{place}]")
    elif isinstance(expected, np.ndarray) and expected.dtype == object:
        np.testing.assert_equal(list(found), list(expected), err_msg=path)
    else:
        assert np.asarray(found).dtype == np.asarray(expected).dtype, path
        if rtol:
            np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol, err_msg=path)
        else:
            np.testing.assert_array_equal(found, expected, err_msg=path)

"""What the tests of the Python module look at."""

import warnings

import pytest

np = pytest.importorskip("numpy", reason="no numpy: pip install numpy")

LEVELS = ["paper", "draft", "standard", "high", "reference", "finite-strain"]
LAYERS = ["depth", "surface", "contact", "normal", "pressure", "markers", "reference"]


def same(one, other):
    """Two samples of the module are the same in every bit."""
    assert list(one) == list(other), (list(one), list(other))
    for name, value in one.items():
        assert type(value) is type(other[name]), name
        assert np.array_equal(value, other[name]) if isinstance(value, np.ndarray) else value == other[name], name


def warned(call):
    """What a call gives, and what it warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        given = call()
    return given, [str(warning.message) for warning in caught]


def refusal(kind, call):
    """What the exception says, which is of this kind exactly."""
    with pytest.raises(kind) as raised:
        call()
    assert raised.type is kind, raised.value
    return str(raised.value)


def refusals(cases):
    """Parametrizes a test with what is refused: a call, the exception's kind, and what it says."""
    return pytest.mark.parametrize("call, kind, words", list(cases.values()), ids=list(cases))


def assert_refused(call, kind, words):
    """A call raises an exception that says a word, or several."""
    said = refusal(kind, call)
    assert all(word in said for word in ([words] if isinstance(words, str) else words)), said

"""The licence check can say no."""

import importlib.util
from pathlib import Path

import pytest

FILE = Path(__file__).resolve().parents[2] / ".ci/licenses.py"
spec = importlib.util.spec_from_file_location("licenses", FILE)
licenses = importlib.util.module_from_spec(spec)
spec.loader.exec_module(licenses)

ALLOW = {"MIT", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "Zlib"}


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("MIT", True),
        ("GPL-3.0", False),
        ("MIT OR GPL-3.0", True),
        ("MIT AND GPL-3.0", False),
        ("MIT/GPL-3.0", True),
        ("GPL-3.0 OR MIT AND Zlib", True),
        ("(GPL-3.0 OR MIT) AND Zlib", True),
        ("(GPL-3.0 OR MIT) AND LGPL-2.1", False),
        ("Apache-2.0 WITH LLVM-exception", True),
        ("MIT WITH LLVM-exception", False),
    ],
)
def test_expressions(expression, expected):
    assert licenses.allowed(expression, ALLOW) is expected


@pytest.mark.parametrize("expression", ["MIT MIT", "(MIT", "", "MIT OR"])
def test_what_cannot_be_read_is_refused(expression):
    with pytest.raises(ValueError):
        licenses.allowed(expression, ALLOW)


def test_every_kind_of_problem_is_said():
    good = {"name": "a", "version": "1", "source": licenses.CRATES_IO, "license": "MIT"}
    assert licenses.problems([good, {**good, "source": None}], ALLOW) == []
    bad = [{**good, "license": "GPL-3.0"}, {**good, "license": None}, {**good, "source": "git+x"}]
    assert len(licenses.problems(bad, ALLOW)) == 3

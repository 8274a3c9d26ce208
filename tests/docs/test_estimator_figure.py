"""Claims of the estimator's page on its figure: which estimate is nearer to the motion, and by how much."""

from pathlib import Path

import numpy as np
import pytest

import experiments
from docs.tools.drawings import accelerations

PAGE = Path(experiments.__file__).parents[1] / "docs" / "estimator.md"


@pytest.mark.skipif(not PAGE.exists(), reason="only a checkout has docs")
def test_the_wrench_is_the_better_accelerometer():
    _, curves = accelerations()
    filtered, true, joint = (values[100:-100] for values in curves.values())
    errors = [np.sqrt(np.mean((x - true) ** 2)) for x in (filtered, joint)]
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert f"off by {errors[0]:.1f} rad/s² (root mean square)" in text
    assert f"is off by {errors[1]:.2f} rad/s²" in text

"""Kernels of linear algebra in the provenance, with advice where the processor has newer ones."""

import pytest

from experiments.document import kernels
from experiments.document.provenance import provenance


@pytest.mark.parametrize(
    ("name", "features", "old"),
    [
        ("Haswell", {"avx2", "avx512f"}, True),
        ("Zen", {"avx512f"}, True),
        ("Haswell", {"avx2"}, False),
        ("SkylakeX", {"avx512f"}, False),
        ("Cooperlake", {"avx512f"}, False),
        ("sapphirerapids", {"avx512f"}, False),
        (None, {"avx512f"}, False),
    ],
)
def test_older_kernels_than_the_processor_s_are_named_with_the_variable(name, features, old):
    text = kernels.advice(name, features)
    assert (text is not None) == old
    assert not old or (f"kernels for {name}," in text and "OPENBLAS_CORETYPE=SkylakeX in the environment" in text)


def test_the_provenance_has_the_kernels_and_the_remark_once(monkeypatch):
    own = provenance({})["linear_algebra"]
    assert own["openblas_kernels"] == kernels.kernels()
    monkeypatch.setattr("experiments.document.provenance.kernels", lambda: "Haswell")
    monkeypatch.setattr("experiments.document.provenance.features", lambda: {"avx512f"})
    made = provenance({})
    assert made["linear_algebra"]["remark"].startswith("OpenBLAS uses its kernels for Haswell")


def test_without_openblas_or_a_list_of_features_nothing_is_said(monkeypatch, tmp_path):
    monkeypatch.setattr(kernels.np, "__file__", str(tmp_path / "numpy" / "__init__.py"))
    assert kernels.kernels() is None
    monkeypatch.setattr(kernels.Path, "read_text", lambda *_, **__: "processor: 0")
    assert kernels.features() == set() and kernels.advice(kernels.kernels(), kernels.features()) is None

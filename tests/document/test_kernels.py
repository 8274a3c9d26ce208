"""Kernels of linear algebra in the provenance, with advice where the processor has newer ones."""

from experiments.document import provenance


def test_the_provenance_has_the_kernels_and_the_remark_once(monkeypatch):
    own = provenance.provenance({})["linear_algebra"]
    assert own["openblas_kernels"] == provenance.kernels()
    monkeypatch.setattr("experiments.document.provenance.kernels", lambda: {"scipy": "Haswell"})
    monkeypatch.setattr("experiments.document.provenance.features", lambda: {"avx512f"})
    made = provenance.provenance({})
    assert made["linear_algebra"]["remark"].startswith("The OpenBLAS of scipy uses its kernels for Haswell")


def test_without_openblas_or_a_list_of_features_nothing_is_said(monkeypatch, tmp_path):
    monkeypatch.setattr(provenance.np, "__file__", str(tmp_path / "numpy" / "__init__.py"))
    assert provenance.kernels() == {}
    monkeypatch.setattr(provenance.Path, "read_text", lambda *_, **__: "processor: 0")
    assert provenance.features() == set() and provenance.advice(provenance.kernels(), provenance.features()) is None

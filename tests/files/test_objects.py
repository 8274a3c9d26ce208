"""Estimates in files: exactly what was saved, without code, and one sentence for what cannot be read."""

import json
import pickle
import zipfile

import numpy as np
import pytest
from commands import sentence_of
from driven_arm import jointly, quick

import ident
from ident import InputError
from ident.files.atomic import load_object


@pytest.mark.parametrize("make", [quick, jointly])
def test_an_estimate_read_back_answers_the_same(tmp_path, make):
    estimate, motion = make(), make().held_out.samples.motion
    estimate.save(tmp_path / "arm.npz")
    again = ident.Estimate.load(tmp_path / "arm.npz")
    assert str(again) == str(estimate) and again.to_dict() == estimate.to_dict()
    answers = ((x.psi, x.covariance_setup, x.consistent().phi, x.predict(motion)) for x in (again, estimate))
    for own, expected in zip(*answers, strict=True):
        np.testing.assert_array_equal(own, expected)
    assert again.compare(estimate).p_value == pytest.approx(1)
    assert again.prepared.mechanism.source is None and again.drives_updated == estimate.drives_updated
    assert [path.name for path in tmp_path.iterdir()] == ["arm.npz"]


def test_other_fields_classes_and_kinds_are_one_sentence(tmp_path):
    path = tmp_path / "arm.npz"
    quick().save(path)
    with np.load(path) as archive:
        arrays = dict(archive)
    content = json.loads(str(arrays["objects"]))
    at = next(k for k, each in enumerate(content["objects"]) if each[0] == "data" and "Fit" in each[1])
    name, own = content["objects"][at][1:]

    def load(**change):
        np.savez(path, **arrays | {"objects": np.array(json.dumps(content | change))})
        ident.Estimate.load(path)

    for entry, message in (
        (["data", name, {**own, "more": 0}], "Fit has other fields in this version"),
        *((["data", name, own], f"it holds '{name}'") for name in ("os:system", "ident.files.atomic:json")),
        (["enum", "subprocess:Popen", "x"], "it holds 'subprocess:Popen'"),
        (["tuple", [at]], "recursion"),
        (["array", "none"], "none"),
        (["thing", 1], ""),
    ):
        with pytest.raises(InputError, match=rf"arm.npz is no saved estimate that this version can read \(.*{message}"):
            load(objects=[*content["objects"][:at], entry, *content["objects"][at + 1 :]])
    assert "arm.npz holds a saved payload; needed is a saved estimate" in sentence_of(load, kind="payload")


def test_what_is_no_saved_estimate_is_one_sentence(tmp_path):
    path = tmp_path / "arm.npz"
    assert "arm.npz cannot be read (No such file" in sentence_of(ident.Estimate.load, path)
    path.write_bytes(pickle.dumps({}))
    with pytest.raises(InputError, match=r"arm.npz is no saved estimate that this version can read \(.*[^.]\)\.$"):
        ident.Estimate.load(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("objects.npy", bytes(10_000_000))
    with pytest.raises(InputError, match="takes 10 MB in memory where at most 1 MB are expected"):
        load_object(path, "estimate", limit=1_000_000)

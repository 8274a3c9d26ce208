"""Estimates in files: exactly what was saved, without code, and one sentence for what cannot be read."""

import json
import pickle
import zipfile

import driven_arm
import numpy as np
import pytest
from driven_arm import jointly, quick

import ident
import sim
from ident import InputError
from ident.files.atomic import load_object


@pytest.mark.parametrize("make", [quick, jointly])
def test_an_estimate_read_back_answers_the_same(tmp_path, make):
    estimate, motion = make(), make().held_out.samples.motion
    estimate.save(tmp_path / "arm.npz")
    again = ident.Estimate.load(tmp_path / "arm.npz")
    assert str(again) == str(estimate) and again.to_dict() == estimate.to_dict()
    for answer in (
        lambda x: x.psi,
        lambda x: x.covariance_setup,
        lambda x: x.consistent().phi,
        lambda x: x.predict(motion),
    ):
        np.testing.assert_array_equal(answer(again), answer(estimate))
    assert again.compare(estimate).p_value == pytest.approx(1)
    assert again.prepared.mechanism.source is None and again.drives_updated == estimate.drives_updated
    assert [path.name for path in tmp_path.iterdir()] == ["arm.npz"]


def test_the_model_is_written_with_the_mechanism_of_its_file(tmp_path):
    (tmp_path / "arm.xml").write_text(driven_arm.text(), encoding="utf-8")
    quick().save(tmp_path / "arm.npz")
    again = ident.Estimate.load(tmp_path / "arm.npz")
    sim.write_model(tmp_path / "new.xml", sim.mechanism(tmp_path / "arm.xml"), again.consistent(), again.drives_updated)
    np.testing.assert_allclose(sim.mechanism(tmp_path / "new.xml").known, again.consistent().phi, rtol=1e-9, atol=1e-12)


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
        (["data", "os:system", own], "it holds 'os:system'"),
        (["data", "ident.files.atomic:json", own], "it holds 'ident.files.atomic:json'"),
        (["data", "ident.files.atomic:_class", own], "it holds 'ident.files.atomic:_class'"),
        (["enum", "subprocess:Popen", "x"], "it holds 'subprocess:Popen'"),
        (["tuple", [at]], "recursion"),
        (["array", "none"], "none"),
        (["thing", 1], ""),
    ):
        with pytest.raises(InputError, match=rf"arm.npz is no saved estimate that this version can read \(.*{message}"):
            load(objects=[*content["objects"][:at], entry, *content["objects"][at + 1 :]])
    with pytest.raises(InputError, match=r"arm.npz holds a saved payload; needed is a saved estimate"):
        load(kind="payload")


def test_what_is_no_saved_estimate_is_one_sentence(tmp_path):
    path = tmp_path / "arm.npz"
    with pytest.raises(InputError, match=r"arm.npz cannot be read \(No such file"):
        ident.Estimate.load(path)
    path.write_bytes(pickle.dumps({}))
    with pytest.raises(InputError, match=r"arm.npz is no saved estimate that this version can read \(.*[^.]\)\.$"):
        ident.Estimate.load(path)
    driven_arm.log(6.0, 50.0).save(path)
    with pytest.raises(InputError, match=r"arm.npz is no saved estimate that this version can read"):
        ident.Estimate.load(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("objects.npy", bytes(10_000_000))
    with pytest.raises(InputError, match="takes 10 MB in memory where at most 1 MB are expected"):
        load_object(path, "estimate", limit=1_000_000)

"""The validation's page, README.md and paper.md show the run on record, and the registry's untried recordings."""

import json

import pytest
from test_readme import DOCS, ROOT, block, page

from docs.tools import pages as blocks
from experiments.studies.validation.files import registry
from experiments.studies.validation.validation_study import study_of
from ident.errors import InputError

pytestmark = pytest.mark.skipif(not DOCS.exists(), reason="only a checkout has docs")


@pytest.fixture(scope="module")
def shown():
    return study_of(json.loads(page(blocks.VALIDATION)), registry())


def test_the_page_shows_the_run_on_record(shown):
    for name, content in blocks.page_blocks(shown).items():
        assert block("validation.md", name) == content, name


@pytest.mark.parametrize("name", ["README.md", "paper.md"])
def test_the_summaries_are_those_of_the_run_on_record(name, shown):
    text = (ROOT / name).read_text(encoding="utf-8")
    for block_name, content in blocks.summary_blocks(shown).items():
        assert f"<!-- {block_name} -->\n{content}<!-- end {block_name} -->" in text


def test_a_new_run_takes_the_place_of_the_one_shown_unless_recordings_are_missing(tmp_path):
    numbers = json.loads(page(blocks.VALIDATION))
    for folder in ("docs", "results/validate"):
        (tmp_path / folder).mkdir(parents=True)
    blocks.write_record(tmp_path / "docs" / blocks.VALIDATION, numbers)
    assert blocks.validated_numbers(tmp_path) == numbers
    (tmp_path / "docs" / "validation.md").write_text(page("validation.md"), encoding="utf-8")
    for name in ("README.md", "paper.md"):
        (tmp_path / name).write_text((ROOT / name).read_text(encoding="utf-8"), encoding="utf-8")
    changed = {**numbers, "recordings": {name: {**x, "seconds": 1.0} for name, x in numbers["recordings"].items()}}
    (tmp_path / "results" / "validate" / "summary.json").write_text(json.dumps(changed), encoding="utf-8")
    blocks.write_validation(tmp_path, blocks.validated_numbers(tmp_path))
    assert json.loads((tmp_path / "docs" / blocks.VALIDATION).read_text(encoding="utf-8")) == changed
    assert (tmp_path / "docs" / "validation.svg").read_bytes().startswith(b"<?xml")
    del changed["recordings"]["walker"]
    (tmp_path / "results" / "validate" / "summary.json").write_text(json.dumps(changed), encoding="utf-8")
    with pytest.raises(InputError, match="has no walker: run it on all"):
        blocks.validated_numbers(tmp_path)

"""The registry: what it holds, and the entries that it refuses."""

import pytest
from registered import FILE, TEXT, written

from experiments.studies.validation import options
from experiments.studies.validation.registry import chosen, read_entry, registry
from ident.errors import InputError, LogError

HASH = "0" * 64
FILES = "".join(FILE.format(name=name, sha256=HASH) for name in ("arm.xml", "one.csv", "two.csv"))
FORBIDDEN = {
    "cutoff": "5.0",
    "holdout": "0.2",
    "estimator": '"weighted"',
    "drive": '["coulomb"]',
    "own": '["offset"]',
    "physical": "true",
    "offsets": "false",
    "setup": "{ delay = 0.1 }",
    "known": "{ mass = 0.1 }",
    "knots": "0.1",
    "threshold": "0.05",
    "weights": "[1.0, 2.0]",
    "select": "{ time = [0, 1] }",
}
"""Options that only the outcome could suggest."""


def entry(where, more="", *, files=FILES, **replaced):
    text = TEXT.format(files=files, more=more)
    for old, new in replaced.items():
        before = next(line for line in text.splitlines() if line.startswith(f"{old} ="))
        text = text.replace(before, new, 1)
    return read_entry(written(where, text))


def test_every_entry_is_well_formed_and_half_of_them_are_of_other_hands():
    entries = registry()
    tried = {name for name, each in entries.items() if each.tried}
    assert tried == {"bow", "double_pendulum", "go2_commands", "go2_torques", "ur10", "walker"}
    assert len(entries) - len(tried) >= 6
    theirs = {entries[name].source.repository for name in entries if name not in tried}
    assert theirs.isdisjoint(entries[name].source.repository for name in tried) and len(theirs) >= 6
    for each in entries.values():
        assert each.files and each.about and each.title and (each.tried or each.note)
        assert set(each.options) <= set(options.ALLOWED)
        if not each.tried:
            assert not any((file.sha256, file.original) != ("", "") for file in each.files)
            assert not each.published and not each.held_out and not each.alike
    assert list(entries)[: len(tried)] == sorted(tried)


def test_no_two_recordings_of_one_folder_disagree_on_a_file():
    hashes = {}
    for each in registry().values():
        for file in each.files:
            assert hashes.setdefault((each.folder, file.name), file.sha256) == file.sha256


@pytest.mark.parametrize("name", FORBIDDEN)
def test_options_that_only_the_outcome_could_suggest_are_refused(name, tmp_path):
    with pytest.raises(InputError, match=f"documentation decides.*got '{name}'"):
        entry(tmp_path, f"[options]\n{name} = {FORBIDDEN[name]}\n")


@pytest.mark.parametrize("table", ["[setup]\ndelay = 0.1", "[known]\nmass = 0.1", "[select]\ntime = [0.0, 1.0]"])
def test_columns_files_with_such_choices_are_refused(table, tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.studies.validation.registry.columns_file", lambda name: tmp_path / name)
    (tmp_path / "mine.toml").write_text(f'[joints.turn]\nposition = "q"\n{table}\n', encoding="utf-8")
    with pytest.raises(InputError, match=f"what a recording holds .* got '{table[1:6].rstrip(']')}"):
        entry(tmp_path, '[options]\ncolumns = "mine.toml"\n')


def test_a_columns_file_states_no_uncertainty_of_a_gain(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.studies.validation.registry.columns_file", lambda name: tmp_path / name)
    (tmp_path / "mine.toml").write_text('[joints.turn]\nposition = "q"\ntorque_std = 0.1\n', encoding="utf-8")
    with pytest.raises(InputError, match="'turn' states torque_std"):
        entry(tmp_path, '[options]\ncolumns = "mine.toml"\n')
    with pytest.raises(LogError, match="exists"):
        entry(tmp_path, '[options]\ncolumns = "absent.toml"\n')


@pytest.mark.parametrize(
    ("replaced", "message"),
    [
        ({"title": "titel = 'Arm'"}, "no 'titel'"),
        ({"title": ""}, "incomplete"),
        ({"repository": "repository = 'https://example.org'"}, "'owner/name'"),
        ({"commit": "commit = 'main'"}, "needs a commit of at least 7 hex digits"),
        ({"sha256": "sha256 = 'abc'"}, "64 hexadecimal digits"),
        ({"sha256": ""}, "was tried and arm.xml has no hash"),
        ({"tried": "tried = false"}, "is untried, and arm.xml has hash|untried"),
        ({"model": "model = 'other.xml'"}, "'other.xml', which is not among its files"),
        ({"fitted": "fitted = [['three.csv']]"}, "'three.csv', which is not among its files"),
        ({"fitted": "fitted = 'one.csv'"}, "list of tables or lists"),
        ({"fitted": ""}, "says nothing of what is fitted"),
        *(
            ({key: f"{key} = {name}"}, "stay in their folder")
            for key in ("folder", "name", "path")
            for name in (
                *(
                    "'../../evil'",
                    "'/etc/passwd'",
                    "'..'",
                    "'.'",
                    '"a\\u0000b"',
                    '"a\\nb"',
                    "'a\\b'",
                    "'a/../b'",
                    "'~/..'",
                ),
                *("'C:/x\\y'", "'a.'", "' a'", f"'{'a' * 101}'", "'-rf'", "'a//b'", "'a/'", "'é'", "'.hidden'"),
            )
        ),
        *(({"folder": f"folder = {name}"}, "stay in their folder") for name in ("''", "'a/b'", "'C:'")),
        ({"fitted": "fitted = [['one.csv']]\noptions = { columns = '../../other.toml' }"}, "stay in their folder"),
        ({"repository": "repository = '../..'"}, "'owner/name'"),
        ({"licence": "licence = 'MIT'\nlicense = 'MIT'"}, "unknown entries"),
        ({"path": "path = 'arm.xml'\nconverter = 'magic'"}, "converters are declared_world"),
        ({"about": "about = "}, "TOML"),
        ({"commit": "commit = '0123ab'"}, "a commit of at least 7 hex digits, at most 40, got 0123ab"),
        *(
            ({"fitted": f"fitted = [['one.csv']]\n{text}"}, message)
            for text, message in (
                ("held_out = 0.3", "'held_out' of its file needs a table of numbers, got 0.3"),
                ("held_out = { lift = 'low' }", "'held_out' of its file needs a table of numbers, got low"),
                ("reference = 0.3", "'reference' needs a table"),
                ("reference = { ratios = {} }", "'reference' is incomplete"),
                (
                    "reference = { source = 'x', best = 'five' }",
                    "'best' of its reference needs a whole number, got five",
                ),
                ("reference = { source = 'x', worse = true }", "'worse' of its reference needs a number, got True"),
                ("alike = [[1]]", "'alike' needs lists of names"),
                ("alike = [{}]", "'alike' needs lists of names"),
                ("options = 5", "'options' of its file needs a table, got 5"),
                ("published = [{ name = 5, value = 1 }]", "'name' of its published needs a text, got 5"),
            )
        ),
        ({"tried": "tried = 'yes'"}, "'tried' of its file needs true or false, got yes"),
        ({"repository": "repository = 5"}, "'repository' of its source needs a text, got 5"),
        ({"sha256": "sha256 = [[1]]"}, "'sha256' of its files needs a text"),
        ({"name": "name = 1.5"}, "'name' of its files needs a text, got 1.5"),
        ({"model": "model = {}"}, "'model' of its file needs a text"),
    ],
)
def test_malformed_entries_are_refused(replaced, message, tmp_path):
    with pytest.raises(InputError, match=message):
        entry(tmp_path, **replaced)


def test_an_untried_entry_has_no_numbers(tmp_path):
    without = FILES.replace(HASH, "")
    for more in ("[held_out]\nlift = 0.2\n", "[reference]\nsource = 'x'\nbest = 1\n"):
        with pytest.raises(InputError, match="arm is untried, and has numbers to compare with"):
            entry(tmp_path, more, files=without, tried="tried = false")


def test_references_are_of_channels_and_every_one_says_how_it_was_reached():
    references = {name: each.reference for name, each in registry().items() if each.reference}
    assert set(references) == {"bow", "double_pendulum", "go2_torques", "ur10", "walker"}
    assert all(each.source for each in references.values())
    assert references["ur10"].ratios["wrist_3_joint"] == 0.295 and references["walker"].best == 5


def test_options_of_the_wrong_kind_are_refused(tmp_path):
    with pytest.raises(InputError, match="'gaps' is of the wrong kind"):
        entry(tmp_path, '[options]\ngaps = "yes"\n')
    with pytest.raises(InputError, match="'fix' needs a list of numbers for 'turn', got 5"):
        entry(tmp_path, "[options.fix]\nturn = 5\n")
    with pytest.raises(InputError, match="'leave_out' needs a list of names, got 5"):
        entry(tmp_path, "[options]\nleave_out = [5]\n")


def test_recordings_are_chosen_by_name_and_a_wrong_one_lists_them():
    entries = registry()
    assert [each.name for each in chosen(["ur10", "bow"], entries)] == ["bow", "ur10"]
    assert len(chosen([], entries)) == len(entries)
    with pytest.raises(InputError, match=r"Recordings are bow, .*; got 'ur11'"):
        chosen(["ur11"], entries)

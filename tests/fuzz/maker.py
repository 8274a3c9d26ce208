"""The arguments of one case: files and options with a few errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .corpus import LOGS, MODELS, PAIR
from .damage import NAMES, Rng, any_of, damaged
from .other_files import MARKERS, RESULT_FILES, RESULTS


@dataclass(frozen=True, eq=False)
class Maker:
    """Makes the arguments of one case with one or two errors: in `model`, `log`, `columns` or `options`."""

    corpus: Path
    folder: Path
    rng: Rng
    wrong: frozenset[str]

    def identify(self) -> list[str]:
        """Arguments of `identify`."""
        name = any_of(self.rng, list(MODELS))
        mapping = self.file("columns", f"{name}.toml")
        files = [
            self.file("model", any_of(self.rng, MODELS[name])),
            self.log(name),
        ]
        right = {
            "--base": ["base"],
            "--columns": [mapping],
            "--cutoff": ["auto", "20"],
            "--holdout": ["0.4", "0.05"],
            "--held-out": [self.file("log", f"{name}.csv", "other.csv")],
            "--no-offsets": [],
            "--estimator": ["ordinary", "weighted", "trajectory"],
            "--prior": ["auto", "on", "off"],
            "--own": ["offset", "delay"],
        }
        wrong = {
            "--base": ["link1", "link2", "world", "$", ""],
            "--columns": ["absent.toml", files[0], "."],
            "--cutoff": ["0", "nan", "49", "1e-9", "1e9", "x"],
            "--holdout": ["0.9", "2", "nan"],
            "--held-out": [files[0], files[1], "absent.csv", "."],
            "--drive": ["viscous", "coulomb", "rotor", "stribeck", "x"],
            "--ignore": ["grip", "x", "$"],
            "--name": ["..", "a/b", "", "$", "\u202e", "x" * 300],
        }
        always = ("--base", "--columns") if "columns" in self.wrong or name == "pad" else ("--base",)
        return [*files, *self.options(right, wrong, always)]

    def compare(self) -> list[str]:
        """Arguments of `compare`; errors in a log are in one of the files of results."""
        hit = any_of(self.rng, [(folder, name) for folder in RESULTS for name in RESULT_FILES])
        for folder in RESULTS:
            (self.folder / folder).mkdir()
            for name in RESULT_FILES:
                self.file("log" if (folder, name) == hit else "", f"{folder}/{name}")
        folders = [str(self.folder / folder) for folder in RESULTS]
        return [*folders, *self.options({"--formats": ["none"]}, {"--formats": ["3", "x"]})]

    def angles(self) -> list[str]:
        """Arguments of `angles`."""
        ending = any_of(self.rng, MARKERS)
        files = [self.file("model", "marked.xml"), self.file("log", f"marked.{ending}")]
        right = {"--base": ["base"], "--scale": [], "--wrenches": [self.file("columns", "plain.csv")], "--mass": ["70"]}
        wrong = {
            "--base": ["x", ""],
            "--mass": ["0", "nan", "-1"],
            "--places": [files[0], "absent"],
            "--symmetric": [""],
        }
        wrong |= {"--scale-from": [files[0], "absent", files[1]], "--wrenches": [files[0], files[1], "."]}
        return [*files, "--formats", "png", *self.options(right, wrong, ("--base",))]

    def payload(self) -> list[str]:
        """Arguments of `payload`."""
        files = [self.file("model", "wrist.xml"), self.file("log", f"wrist.{any_of(self.rng, ('csv', 'npz'))}")]
        right = {"--body": ["tool"], "--sensor": ["wrist"], "--columns": [self.file("columns", "wrist.toml")]}
        right |= {"--holdout": ["0.4"], "--no-offsets": [], "--flange": ["link7"]}
        wrong = {
            "--body": ["link1", "x", "", "world"],
            "--sensor": ["x", ""],
            "--flange": ["x"],
            "--holdout": ["1", "nan"],
        }
        return [*files, *self.options(right, wrong, ("--body", "--sensor", "--columns"))]

    def human(self) -> list[str]:
        """Arguments of `human`, which always have an error: valid ones take minutes."""
        wrong = {"--seconds": ["1", "1e9", "x"], "--rate": ["1", "nan"], "--noise": ["0", "-1", "nan", "30", "inf"]}
        wrong |= {"--activities": ["sleeping", "", "$"], "--from": ["films"], "--persons": ["0"], "--workers": ["-1"]}
        wrong |= {"--seed": ["-1", "x"]}
        option = any_of(self.rng, list(wrong))
        return ["--seconds", "2", option, str(any_of(self.rng, wrong[option]))]

    def excite(self) -> list[str]:
        """Arguments of `excite`."""
        name = any_of(self.rng, list(MODELS))
        model = self.file("model", any_of(self.rng, MODELS[name]))
        right = {"--base": ["base"], "--joints": ["joint1", "joint2"], "--criterion": ["determinant", "condition"]}
        right |= {"--sensors": ["torque"], "--collisions": ["ignore"]}
        wrong = {"--base": ["x", "", "link2"], "--joints": ["x", ""], "--seconds": ["0", "1e-7", "1e7", "nan"]}
        wrong |= {"--velocity": ["1e-7", "1e7"], "--acceleration": ["0"], "--harmonics": ["1", "100"], "--noise": ["x"]}
        little = ["--starts", "1", "--iterations", "2", "--seconds", "2", "--formats", "png"]
        return [model, *little, *self.options(right, wrong, ("--base",))]

    def log(self, name: str) -> str:
        """A log in any of the formats, perhaps in two files."""
        ending = any_of(self.rng, LOGS)
        names = [file.format(name) for file in PAIR] if ending == "pair" else [f"{name}.{ending}"]
        return "+".join(self.file("log", each) for each in names)

    def file(self, what: str, name: str, new: str | None = None) -> str:
        """A copy of a file of the corpus, damaged if it is to have an error; sometimes with a strange name then."""
        data, path = (self.corpus / name).read_bytes(), self.folder / (new or name)
        if what in self.wrong:
            for _ in range(int(any_of(self.rng, (1, 1, 1, 2, 3)))):
                data = damaged(data, path.suffix, self.rng) or b" "
            if self.rng.random() < 0.05:
                strange = any_of(self.rng, [n for n in NAMES if "/" not in n and "\0" not in n])
                path = path.with_name(f"{strange[:20]}{path.suffix}")
        path.write_bytes(data)
        return str(path)

    def options(
        self, right: dict[str, list[str]], wrong: dict[str, list[str]], always: Sequence[str] = ()
    ) -> list[str]:
        """Some options with valid values, or, if options are to have an error, with one invalid value."""
        chosen = {option: right[option] for option in right if option in always or self.rng.random() < 0.15}
        if "options" in self.wrong:
            option = any_of(self.rng, list(wrong))
            chosen[option] = wrong[option]
        pairs = ([option, *([any_of(self.rng, values)] if values else [])] for option, values in chosen.items())
        return [argument for pair in pairs for argument in pair]

"""Report on the identification of a payload: numbers in the formats of robots and simulators, tables, a page."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from experiments.document import tabular
from experiments.document.result_folder import OUTPUTS as RESULTS
from experiments.document.tabular import of_deviations, of_numbers
from experiments.document.typography import wrapped
from experiments.document.writer import Card, Document, Headline, Plot, environment
from experiments.reports import identify_page, identify_report
from ident.estimation.noise import offset_unit
from ident.estimation.preparation import length
from ident.files.readers import name_of
from ident.geometry.inertia import symmetric
from ident.judgement.wording import number_of
from ident.payload import QUANTITIES, UNITS, Payload, RigidBody, SensorParameter
from sim.models.model_update import write_model
from sim.models.xml_files import parsed

OUTPUTS = (*RESULTS, "payload.json", "payload.txt", "model.xml", "model.urdf")
"""Patterns of the files that it writes."""


def _sensor_unit(each: SensorParameter) -> str:
    """Unit of a sensor's parameter."""
    return offset_unit(each.name) if each.setup is None else each.setup.row.unit.si


def _in_words(each: SensorParameter) -> str:
    """A sensor's parameter in words: `rotation_x(wrist)` is its turn about x."""
    if each.setup is None:
        return each.name.replace("offset(", "offset of ").removesuffix(")")
    return each.setup.text(each.setup.row.label)


@dataclass(frozen=True)
class PayloadReport:
    """Report on a payload.

    Attributes:
        payload: The payload.
        flange: Name of the body or site in whose frame controllers expect it.
    """

    payload: Payload
    flange: str

    @property
    def at_flange(self) -> RigidBody:
        """The payload in the flange's frame."""
        return self.payload.in_frame(self.payload.place_of(self.flange))

    def forms(self) -> dict[str, str]:
        """The numbers with their intervals as text for other programs, by program."""
        return dict(each.split("\n", 1) for each in self.forms_text().strip().split("\n\n"))

    def forms_text(self) -> str:
        """The forms as one text."""
        own, at_flange = self.payload.in_frame(), self.at_flange
        matrix = symmetric(at_flange.values[4:]).ravel()
        names = {"body": self.payload.body, "flange": self.flange, "names": QUANTITIES[4:], "matrix": matrix}
        template = environment().get_template("payload.txt")
        return template.render(own=own, at_flange=at_flange, **names).rstrip() + "\n"

    def table(self, *, brief: bool = False) -> tabular.Table:
        """Mass, centre of mass and inertia with their intervals, beside the model's; briefly without deviations."""
        body, model = self.payload.in_frame(), self.payload.model
        more: dict[str, Any] = {"model": [None] * 10 if model is None else model.tolist()}
        more["note"] = ["" if each else "not determined by this motion" for each in body.identifiable]
        return _table(f"{self.payload.title}, in the frame of '{self.payload.body}'", body, more, brief=brief)

    def sensor_table(self, *, every: bool = True) -> tabular.Table:
        """Offsets, delay, gains and frame of the sensor, or those alone that are taken out."""
        parameters = [each for each in self.payload.sensor_parameters if every or each.taken_out]
        name, value, std, taken, _ = zip(*parameters, strict=True)
        words = ["taken out" if each else "taken as stated" for each in taken]
        return tabular.Table(
            "The sensor",
            *tabular.columns(parameter=name, estimate=value, std=std, note=words),
            deviations={"estimate": "std"},
            units=tuple(map(_sensor_unit, parameters)),
            names={each.name: _in_words(each) for each in parameters},
        )

    def lines(self) -> list[str]:
        """Lines on the logs, the payload's bodies and the sensor's place."""
        result, payload = self.payload.estimate, self.payload
        return [
            f"{number_of(len(result.logs), 'log')}, {length(result.logs)} samples fitted, "
            f"{len(result.held_out.time)} predicted; condition number {result.condition_number:.3g}.",
            payload.carried,
            *payload.notes,
            *result.prepared.notes,
        ]

    def to_dict(self) -> dict[str, Any]:
        """Everything for scripts, in JSON types."""
        payload = self.payload
        frames = {payload.body: payload.in_frame(), self.flange: self.at_flange}
        return {
            **payload.verdict().to_dict(),
            "findings": [finding.to_dict() for finding in payload.findings],
            "quantities": list(QUANTITIES),
            "frames": {name: {key: x.tolist() for key, x in body._asdict().items()} for name, body in frames.items()},
            "sensor": {each.name: each.to_dict() for each in payload.sensor_parameters},
            "estimate": payload.estimate.to_dict(),
        }

    def screen(self, cards: Sequence[Card]) -> str:
        """Text for the terminal on 24 lines: verdict, mass, centre and inertia, and the first findings."""
        first = [Headline.of(self.payload.verdict()).line, "", self.table(brief=True).text()]
        where = "payload.txt has these for URDF, MJCF and robot controllers; --verbose prints all numbers."
        return "\n".join([*first, *identify_page.first_lines(cards), where])

    def verbose(self) -> str:
        """Longer text for the terminal."""
        payload = self.payload
        taken_out = any(each.taken_out for each in payload.sensor_parameters)
        tables = [self.table().text(), *([self.sensor_table(every=False).text()] if taken_out else [])]
        verdict = [f"Verdict: {payload.verdict()}", *(finding.line for finding in payload.findings)]
        # Forms are for copying: they are not wrapped.
        return "\n".join([wrapped("\n".join([*self.lines(), "", *tables])), self.forms_text(), *map(wrapped, verdict)])

    def document(self, model: Path | None, logs: Sequence[Path], provenance: dict[str, Any]) -> Document:
        """Tables, a figure, the forms, numbers for scripts, and the updated model file if it has masses.

        Args:
            model: The model file, None without one.
            logs: The logs.
            provenance: Provenance of the results.
        """
        payload, robot = self.payload, self.payload.robot
        files: dict[str, Callable[[Path], object]] = {
            "payload.txt": lambda path: path.write_text(self.forms_text(), encoding="utf-8")
        }
        if model is not None and robot.prior is not None:
            updated = f"model.{'urdf' if parsed(model).tag == 'robot' else 'xml'}"
            files[updated] = lambda path: write_model(path, robot, payload.phi_of_robot())
        tables = {"table_payload": self.table()}
        if self.flange != payload.body:
            tables["table_flange"] = _table(f"The same in the frame of '{self.flange}'", self.at_flange, {})
        if payload.sensor_parameters:
            tables["table_sensor"] = self.sensor_table()
        tables["table_held_out"] = identify_report.quality_table(payload.estimate)
        caption = f"Measured and predicted channels on the {payload.estimate.held_out.part} part."
        cards = [*map(Card.of, payload.findings)]
        return Document(
            f"Payload of {model.name if model else payload.body}, identified from {', '.join(map(name_of, logs))}",
            headline=Headline.of(payload.verdict()),
            verdict=str(payload.verdict()),
            pictures=[*identify_page.prediction(payload.estimate)],
            findings=cards,
            lines=self.lines(),
            heading="The recording",
            tables=tables,
            figures={"figure_held_out": Plot(partial(identify_page.held_out_figure, payload.estimate), caption)},
            numbers={"payload": self.to_dict(), "provenance": provenance},
            blocks=self.forms(),
            files=files,
            screen=self.screen(cards),
            verbose=self.verbose(),
        )


def _table(title: str, body: RigidBody, more: dict[str, Any], *, brief: bool = False) -> tabular.Table:
    """Estimates and 95 % intervals, without `brief` also standard deviations, and more columns."""
    of_estimate = of_numbers(body.std_setup)
    columns: dict[str, Any] = {"quantity": QUANTITIES, "unit": UNITS, "estimate": body.values.tolist()}
    columns |= {} if brief else {"std": body.std.tolist(), "std_setup": body.std_setup.tolist()}
    columns |= dict(zip(("from_95", "to_95"), body.intervals.T.tolist(), strict=True))
    digits = dict.fromkeys(("estimate", "from_95", "to_95", "model"), of_estimate)
    digits |= {"std": of_deviations(body.std), "std_setup": of_deviations(body.std_setup)}
    return tabular.Table(title, *tabular.columns(**columns, **more), decimals=6, digits=digits)

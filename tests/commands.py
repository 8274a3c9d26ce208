"""Refusals of bad input by commands and calls, and tables and entries of the files that they write."""

import csv
import json

import pytest

from ident.errors import InputError


def refusal(main, arguments, capsys):
    """Error message of a command for bad input; it must exit with 2 and without a traceback."""
    try:
        code = main(arguments)
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    error = capsys.readouterr().err
    assert "Traceback" not in error
    return error


def sentence_of(call, *given, **options):
    """The one sentence that refuses a call."""
    with pytest.raises(InputError) as refused:
        call(*given, **options)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def rows_of(path):
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def entries_of(path):
    return json.loads(path.read_text(encoding="utf-8"))

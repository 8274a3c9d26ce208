"""Hostile names are shown literally, by readers of each format that are written for these tests."""

import re

from hypothesis import example, given, settings
from hypothesis import strategies as st

from experiments.document import symbols

EVIL = [
    r"\input{/etc/passwd}",
    r"\write18{ls}",
    "<script>alert(1)</script>",
    "$x",
    "$\\foo$",
    "a|b",
    "&%$#_{}~^\\",
    "[1cm] *star* `code` ![x](y) __b__ _i_ ~~s~~",
    "a--b---c",
    "two\nlines\r\t",
    "Größe, \N{ARABIC LETTER ALEF}",
]
TEXTS = st.one_of(st.text("\\{}$&#%_^~|[]*`<>!-ab \n", max_size=12), st.sampled_from(EVIL))

COMMANDS = {
    "textbackslash": "\\",
    "textasciitilde": "~",
    "textasciicircum": "^",
    "textless": "<",
    "textgreater": ">",
    "textbar": "|",
}


def shown_by_tex(source):
    """Text that TeX typesets; any command raises an error."""
    out, rest = "", source
    while rest:
        if match := re.match(r"\\([&%$#_{}])|\\([a-z]+)\{\}|\{([\[*]?)\}|([^&%$#_{}~^\\])", rest):
            out += match[1] or (match[2] and COMMANDS[match[2]]) or match[3] or match[4] or ""
            rest = rest[match.end() :]
        else:
            raise AssertionError(f"TeX would act on {rest!r}")
    assert "--" not in source and not re.match(r" *[\[*]", source)
    return out


def shown_by_markdown(source):
    """Text that a Markdown table shows; any markup raises an error."""
    within_words = re.sub(r"(?<=[^\W_])_(?=[^\W_])", r"\\_", source)
    out, rest = "", within_words
    while rest:
        match = re.match(r"\\([!-/:-@\[-`{-~])|([^\\`*_{}\[\]<>|~$&#!\n])", rest)
        assert match, f"Markdown would act on {rest!r}"
        out, rest = out + (match[1] or match[2]), rest[match.end() :]
    return out


def in_a_line(text):
    return re.sub(r"[\n\r\t]+", " ", text)


@settings(max_examples=300, deadline=None)
@given(TEXTS)
@example("_a_")
def test_all_letters_are_shown_and_none_is_acted_on(text):
    assert shown_by_tex(symbols.tex(text)) == in_a_line(text)
    assert shown_by_markdown(symbols.markdown(text)) == in_a_line(text)

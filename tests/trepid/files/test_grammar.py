"""Parsers from kept tables are those that the grammar gives, and no damage to a file breaks a start."""

import sys

import pytest
from lark import Lark
from lark.exceptions import UnexpectedInput

from supervisor.rules import sentence
from trepid.files.grammar import lalr

SENTENCES = (
    "if speed is low then fear is high",
    "if not (speed is low or age is not high) and x is medium then fear is very_high with weight 0.5 because dark",
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "trepid" / "grammars"


@pytest.fixture
def no_computing(monkeypatch):
    """Call it to make every computation of tables fail."""

    def fail(*_arguments, **_options):
        raise AssertionError("the tables are computed")

    return lambda: monkeypatch.setattr(Lark, "__init__", fail)


def test_the_second_parser_is_loaded_and_parses_as_the_first(folder, no_computing):
    first = lalr(sentence.GRAMMAR)
    no_computing()
    second = lalr(sentence.GRAMMAR)
    for text in SENTENCES:
        assert second.parse(text) == first.parse(text)


def test_a_loaded_parser_reports_an_error_at_the_same_place_with_the_same_expectations(folder):
    found = []
    for parser in (lalr(sentence.GRAMMAR), lalr(sentence.GRAMMAR)):
        parsing = parser.parse_interactive("if speed is low or then fear is high")
        with pytest.raises(UnexpectedInput) as error:
            parsing.exhaust_lexer()
        found.append((error.value.pos_in_stream, parsing.accepts()))
    assert found[0] == found[1]


def test_another_grammar_option_or_version_of_lark_has_tables_of_its_own(folder, monkeypatch):
    lalr(sentence.GRAMMAR)
    lalr(sentence.GRAMMAR + "\n// changed\n")
    lalr(sentence.GRAMMAR, positions=True)
    monkeypatch.setattr("lark.__version__", "99")
    lalr(sentence.GRAMMAR)
    assert len(list(folder.iterdir())) == 4


@pytest.mark.parametrize("damage", ["emptied", "cut", "one bit", "other"])
def test_a_damaged_file_is_computed_and_written_again(folder, no_computing, damage):
    whole = lalr(sentence.GRAMMAR).parse(SENTENCES[0])
    (file,) = folder.iterdir()
    good = file.read_bytes()
    middle = len(good) // 2
    flipped = good[:middle] + bytes([good[middle] ^ 1]) + good[middle + 1 :]
    file.write_bytes({"emptied": b"", "cut": good[:middle], "one bit": flipped, "other": b"other"}[damage])
    assert lalr(sentence.GRAMMAR).parse(SENTENCES[0]) == whole
    no_computing()
    assert lalr(sentence.GRAMMAR).parse(SENTENCES[0]) == whole


def test_a_folder_in_the_place_of_a_file_costs_only_the_computation(folder):
    lalr(sentence.GRAMMAR)
    (file,) = folder.iterdir()
    file.unlink()
    file.mkdir()
    assert lalr(sentence.GRAMMAR).parse(SENTENCES[0])


@pytest.mark.skipif(sys.platform != "linux", reason="/proc is a folder of Linux")
def test_a_folder_that_cannot_be_written_costs_only_the_computation(monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    assert lalr(sentence.GRAMMAR).parse(SENTENCES[0])

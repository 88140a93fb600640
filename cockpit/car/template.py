"""The text of a settings file of a new car: the fields of its template, and all others as comments.

The default file gives every field with its unit, default and source. Each of its lines gets a ``#``, so that an
edit is the removal of that character; the fields of the template stand uncommented below their default.
"""

import re
from itertools import pairwise

_FIELD = re.compile(r"(\s*)([\w.-]+|\"[^\"]+\"|'[^']+')\s*:(?:\s|$)")
_ITEM = re.compile(r"\s*- ")


def merge(default: str, template: str) -> str:
    """The text of the default file with its fields as comments, and with the fields of ``template`` active.

    A field that both give as a block of further fields is merged line by line.
    """
    lines = _merge_lines(default.splitlines(), template.splitlines(), indent=0)
    return "\n".join(lines) + "\n"


def _merge_lines(default: list[str], template: list[str], indent: int) -> list[str]:
    above, ours = _blocks(template, indent)
    head, theirs = _blocks(default, indent)
    lines = [*above, *(_comment_out(line) for line in head)]
    for name, block in theirs.items():
        given = ours.pop(name, None)
        if given is None:
            lines += [_comment_out(line) for line in block]
            continue
        inner = _indent_below(block)
        if inner is not None and inner == _indent_below(given):
            lines += [given[0], *_merge_lines(block[1:], given[1:], inner)]
        else:
            kept, after = _without_end(block)
            lines += [*(_comment_out(line) for line in kept), *_without_end(given)[0]]
            lines += [_comment_out(line) for line in after]
    return lines + [line for block in ours.values() for line in block]


def _blocks(lines: list[str], indent: int) -> tuple[list[str], dict[str, list[str]]]:
    """The lines before the first field at ``indent``, and the lines of each field.

    Comments belong to the field above them.
    """
    starts = [
        number
        for number, line in enumerate(lines)
        if (found := _FIELD.match(line)) and len(found[1]) == indent
    ]
    spans = [lines[begin:end] for begin, end in pairwise([*starts, len(lines)])]
    head = lines[: starts[0]] if starts else lines
    return head, {str(_name(span[0])): span for span in spans}


def _name(line: str) -> str | None:
    found = _FIELD.match(line)
    return found[2].strip("\"'") if found else None


def _indent_below(block: list[str]) -> int | None:
    """Indentation of the fields below the first line of ``block``; None when it holds a value or a list."""
    for line in block[1:]:
        found = _FIELD.match(line)
        if _ITEM.match(line):
            return None
        if found:
            return len(found[1])
    return None


def _without_end(block: list[str]) -> tuple[list[str], list[str]]:
    """``block`` and the comments and empty lines at its end, which introduce the next field."""
    end = len(block)
    while end > 1 and (not block[end - 1].strip() or block[end - 1].lstrip().startswith("#")):
        end -= 1
    return block[:end], block[end:]


def _comment_out(line: str) -> str:
    """``line`` as a comment; empty lines and comments stay as they are."""
    return line if not line.strip() or line.lstrip().startswith("#") else f"#{line}"

"""Parsers of lark, LALR(1), whose tables are computed once and kept (:mod:`trepid.files.cache`).

Computing the tables of a small grammar takes as long as importing lark. A file holds the tables as lark saves them,
after a hash of them: a damaged file is computed again.
"""

import hashlib
import io
import sys

import lark
from lark import Lark

from trepid.files.cache import cache_file, cached_content, keep

_HASH_BYTES = hashlib.sha256().digest_size


def lalr(grammar: str, *, placeholders: bool = True, positions: bool = False) -> Lark:
    """The parser of ``grammar``; a terminal is matched only where it is allowed.

    placeholders: an optional part that is absent is None in the tree. positions: branches of the tree have places.
    """
    options = dict(parser="lalr", maybe_placeholders=placeholders, propagate_positions=positions)
    path = cache_file("grammars", repr((grammar, options, lark.__version__, sys.version_info[:3])), ".lark")
    tables = cached_content(path)
    if hashlib.sha256(tables[_HASH_BYTES:]).digest() == tables[:_HASH_BYTES]:
        return Lark.load(io.BytesIO(tables[_HASH_BYTES:]))
    parser = Lark(grammar, **options)
    if path is not None:
        saved = io.BytesIO()
        parser.save(saved)
        keep(path, hashlib.sha256(saved.getvalue()).digest() + saved.getvalue())
    return parser

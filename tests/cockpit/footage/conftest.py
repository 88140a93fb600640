"""Images of a drawn road in files, for the tests of footage."""

from footage_rig import clip, folder, picture  # noqa: F401 - fixtures

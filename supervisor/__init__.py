"""Estimates -> Decision: how afraid to be, of what, which path to drive, and how fast.

``rules`` reads the rule file, ``inference`` turns named numbers into fear, ``features`` turns messages into those
numbers, ``fusion`` joins the estimates into one path, ``follow`` makes a path behind the vehicle ahead, ``modes``
holds every transition, and ``supervisor`` is the step that ties them together.
"""

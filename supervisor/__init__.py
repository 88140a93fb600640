"""Estimates -> Decision: how afraid to be, of what, which path to drive, and how fast.

``sightings`` judges the messages, ``watchdog`` who has gone silent, ``fusion`` joins the estimates into one path,
``follow`` makes a path behind the vehicle ahead, ``features`` turns it all into named numbers, ``rules`` reads the
rule file, ``inference`` turns numbers into fear, ``modes`` holds every transition, and ``supervisor`` is the step
that ties them together. ``verify`` tries a rule file before it drives.
"""

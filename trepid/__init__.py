"""Trepid: a camera lane keeper for research vehicles with a fuzzy supervisor.

This package is the vocabulary that the others share: messages, topics, the Zenoh bus, camera and vehicle
geometry, configuration, processes and the command line. It holds no driving algorithm.

Conventions everywhere (ISO 8855 / REP 103): x forward, y left, z up; angles, curvature, steering and lateral
offset are positive to the left; SI units, and every name carries its unit.
"""

__version__ = "0.1.0"

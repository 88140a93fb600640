"""Estimates -> Decision: fear and its cause, the mode, the path and the speed cap.

``inputs`` validates messages and computes features over time, ``path`` fuses estimates and follows the trail of the
vehicle ahead, ``situation`` computes the inputs of the rules, ``rules`` evaluates them, ``modes`` contains causes
and transitions, and ``supervisor`` is the step that calls them.
"""

"""Made-up recordings with known truth: people in motion, cameras around them, masks with the faults of real ones.

``posing`` and the people (``people``, ``strangers``, their ``skirt``) know neither of the rooms ``motion`` (what they
do) and ``footage`` (what is seen of them), which know nothing of each other; ``walk`` joins them to the built-in scene,
the study to its sequences. ``any_body`` records any body in a motion of its own; ``characters`` gives theirs to shipped
bodies that are no people.

May import: body, cameras, masks, result, formats, rigging.
"""

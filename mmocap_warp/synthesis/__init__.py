"""Made-up recordings with known truth: people in motion, cameras around them, masks with the faults of real ones.

The people and ``exact_posing`` use neither ``motion`` (what people do) nor ``footage`` (what cameras see of them), and
these two do not use each other. The study joins them to its sequences; ``any_body`` records any body in a motion of its
own. What made the shipped motions and people that are drawn at random are scripts in ``instruments/``.
"""

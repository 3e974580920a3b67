"""What else the paper prints in its Tables 4 and 5; algorithms are in the order of ``study.paper.ALGORITHM_ORDER``."""

from __future__ import annotations

P_VALUES: dict[tuple[int, int], tuple[str, ...]] = {
    (39, 500): ("-", "0.335", "0.123", "0.043", "7.57E-4", "5.31E-5", "5.62E-7", "7.76E-9"),
    (39, 1500): ("-", "0.500", "0.563", "0.335", "0.016", "3.70E-4", "1.49E-6", "1.49E-5"),
    (39, 3000): ("-", "0.335", "0.563", "0.054", "0.034", "1.18E-4", "5.62E-7", "9.58E-6"),
    (28, 500): ("-", "0.847", "0.289", "0.016", "0.009", "1.18E-4", "7.97E-5", "4.13E-8"),
    (28, 1500): ("-", "0.630", "0.772", "0.083", "0.007", "2.55E-4", "5.31E-5", "7.97E-5"),
    (28, 3000): ("-", "1.000", "0.563", "0.148", "0.009", "0.007", "1.18E-4", "0.002"),
}
"""By model and budget, as printed: truncated, not rounded."""

FRIEDMAN: dict[tuple[int, int], str] = {
    (39, 500): "57.925",
    (39, 1500): "49.148",
    (39, 3000): "48.851",
    (28, 500): "53.481",
    (28, 1500): "43.037",
    (28, 3000): "30.740",
}
"""By model and budget, as printed."""

MISPRINTED: tuple[tuple[int, int], ...] = ((28, 500), (28, 1500))
"""Columns of Table 5 whose printed ranks do not add up to 36, as those of eight algorithms must."""

HOLM: tuple[str, ...] = ("0.050", "0.025", "0.016", "0.012", "0.010", "0.008", "0.007")
"""Thresholds from the second best algorithm to the worst, as printed."""

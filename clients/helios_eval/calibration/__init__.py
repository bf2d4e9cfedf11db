"""Calibration of the object map: scores and uncertainty of its instances against ground truth."""

from helios_eval.calibration.report_figures import Figure, figures

__all__ = ["Figure", "figures"]

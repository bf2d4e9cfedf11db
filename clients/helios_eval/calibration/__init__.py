"""Does the uncertainty mean anything? The map's scores of its instances against the truth."""

from helios_eval.calibration.report_figures import Figure, figures

__all__ = ["Figure", "figures"]

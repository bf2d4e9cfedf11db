"""Published results of the paper, by table and row (percent, ± standard error of the mean).

Numbers are copied from the paper's tables. The paper's simulator is Habitat with HSSD homes (1199
episodes of OVMM) and HM3D (2000 episodes of object navigation); its detector is DETIC.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

OVMM = ("FindObj", "Pick", "FindRec", "Place", "SR")
OBJECTNAV = ("SPL", "SR")
PICKS: tuple[int | None, ...] = (1, 5, None)  # None: unlimited
# Figure 4: GPU memory in GB, map of objects only and of the full scene; a mean over 50 episodes is
# the highest of all steps
FIGURE_4_GB = {
    "allocated, highest mean": (4.1, 8.9),
    "reserved, highest mean": (4.6, 24.3),
    "reserved, maximum": (7.1, 43.0),
}


@dataclass(frozen=True)
class Figure:
    """Published value in percent; `sem` where the paper gives one."""

    mean: float
    sem: float | None = None

    def __str__(self) -> str:
        return f"{self.mean:.1f}" if self.sem is None else f"{self.mean:.1f} ± {self.sem:.1f}"


@dataclass(frozen=True)
class Row:
    """Row of a table: its name in the paper, our runs that match it, and its published values."""

    name: str
    figures: Mapping[str, Figure]
    group: str = ""
    agent: str = ""  # our agent; empty if this project has none
    semantics: str = "noisy"
    picks: int | None = None
    setting: tuple[str, float] | None = None  # the one setting that differs from Table 3


@dataclass(frozen=True)
class Table:
    number: int
    title: str
    benchmark: str
    metrics: tuple[str, ...]
    rows: tuple[Row, ...] = field(default=())


def picks_name(picks: int | None) -> str:
    """Limit of picks in the paper's words."""
    return "unlimited picks" if picks is None else f"{picks} pick{'s' if picks > 1 else ''}"


def _figures(text: str, metrics: tuple[str, ...] = OVMM) -> dict[str, Figure]:
    """Published values by metric from a text like "23.8±1.2 … -"; "-" where the paper has none."""
    out = {}
    for metric, part in zip(metrics, text.split(), strict=True):
        if part != "-":
            mean, _, sem = part.partition("±")
            out[metric] = Figure(float(mean), float(sem) if sem else None)
    return out


HELIOS = {
    1: _figures("23.8±1.2 17.2±1.1 10.0±0.9 3.3±0.5 2.5±0.5"),
    5: _figures("39.2±1.4 28.7±1.3 17.4±1.1 5.8±0.7 3.1±0.5"),
    None: _figures("42.3±1.4 30.5±1.3 18.6±1.1 6.3±0.7 3.2±0.5"),
}
TRUSTING = {
    1: _figures("13.7±1.0 12.3±0.9 6.8±0.7 2.1±0.4 1.3±0.3"),
    5: _figures("20.4±1.2 18.3±1.1 10.2±0.9 3.2±0.5 1.8±0.4"),
    None: _figures("21.9±1.2 19.3±1.1 10.8±0.9 3.3±0.5 1.8±0.4"),
}
NO_GLOBAL = {
    1: _figures("16.8±1.1 12.0±0.9 6.8±0.7 2.6±0.5 1.7±0.4"),
    5: _figures("27.8±1.3 21.2±1.2 12.8±1.0 4.9±0.6 2.3±0.4"),
    None: _figures("29.6±1.3 22.0±1.2 13.2±1.0 5.0±0.6 2.3±0.4"),
}
FIFTY = {
    1: _figures("14.5±1.0 10.5±0.9 6.6±0.7 1.9±0.4 1.5±0.4"),
    5: _figures("23.1±1.2 17.9±1.1 12.0±0.9 3.9±0.6 2.2±0.4"),
    None: _figures("26.0±1.3 19.5±1.1 12.7±1.0 3.9±0.6 2.2±0.4"),
}

TABLE_1 = Table(
    1,
    "components of the method, by number of picks",
    "ovmm",
    OVMM,
    (
        Row(
            "HomeRobot H/N/H",
            _figures("28.7 15.2 5.3 - 0.4"),
            "other work",
            agent="homerobot-heuristic",
        ),
        Row("HomeRobot H/R/R", _figures("29.4 13.2 5.8 - 0.5"), "other work"),
        Row("HomeRobot R/N/H", _figures("21.9 11.5 6.0 - 0.6"), "other work"),
        Row("HomeRobot R/R/R", _figures("21.7 10.2 6.2 - 0.4"), "other work"),
        Row("MoManipVLA", _figures("23.7 12.7 7.1 - 1.7"), "other work"),
        *(
            Row(name, figures[picks], picks_name(picks), agent, picks=picks)
            for picks in PICKS
            for name, agent, figures in (
                ("Trusting agent", "trusting", TRUSTING),
                ("W/o global search objective", "no-global-objective", NO_GLOBAL),
                ("HELIOS", "helios-paper", HELIOS),
            )
        ),
    ),
)
TABLE_2 = Table(
    2,
    "the stop decision in object navigation",
    "objectnav",
    OBJECTNAV,
    (
        Row(
            "VLFM without detection filtering",
            _figures("29.6 50.4", OBJECTNAV),
            agent="vlfm-unfiltered",
        ),
        Row("VLFM", _figures("30.4 52.5", OBJECTNAV), agent="vlfm"),
        Row(
            "VLFM with the stop decision of HELIOS",
            _figures("28.4 54.0", OBJECTNAV),
            agent="vlfm-helios-stop",
        ),
    ),
)
TABLE_4 = Table(
    4,
    "ground-truth semantics, unlimited picks",
    "ovmm",
    OVMM,
    (
        Row("MoManipVLA", _figures("23.7 12.7 7.1 - 1.7")),
        Row("MoManipVLA with ground truth", _figures("66.1 62.6 53.1 - 15.8")),
        Row("Trusting agent", TRUSTING[None], agent="trusting"),
        Row(
            "Trusting agent with ground truth",
            _figures("57.5±1.4 56.5±1.4 44.7±1.4 20.9±1.2 12.8±1.0"),
            agent="trusting",
            semantics="ground-truth",
        ),
        Row("HELIOS", HELIOS[None], agent="helios-paper"),
        Row(
            "HELIOS with ground truth",
            _figures("66.3±1.4 58.3±1.4 53.4±1.4 29.8±1.3 21.0±1.2"),
            agent="helios-paper",
            semantics="ground-truth",
        ),
    ),
)
TABLE_5 = Table(
    5,
    "what the information gain assumes of a measurement",
    "ovmm",
    OVMM,
    tuple(
        Row(name, figures[picks], picks_name(picks), agent, picks=picks)
        for picks in PICKS
        for name, agent, figures in (
            ("50-50", "helios-5050", FIFTY),
            ("Optimistic (HELIOS)", "helios-paper", HELIOS),
        )
    ),
)

_SWEEP_NAMES = {"alpha_cs": "α_cs", "alpha_d": "α_d", "tau_g": "τ_g", "tau_inc": "τ_inc"}
DEFAULTS = {"alpha_cs": 1.0, "alpha_d": 0.001, "tau_g": 0.5, "tau_inc": 0.05}  # Table 3
_SWEEPS: dict[int | None, dict[tuple[str, float], str]] = {
    1: {
        ("alpha_cs", 0.1): "22.8±1.2 15.3±1.0 8.8±0.8 2.6±0.5 2.3±0.4",
        ("alpha_cs", 2): "24.1±1.2 16.6±1.1 10.6±0.9 3.4±0.5 2.2±0.4",
        ("alpha_d", 0.0001): "22.8±1.2 15.4±1.0 9.0±0.8 2.9±0.5 1.8±0.4",
        ("alpha_d", 0.01): "23.4±1.2 16.5±1.1 9.8±0.9 2.9±0.5 2.2±0.4",
        ("tau_g", 0.3): "20.0±1.2 14.5±1.0 7.8±0.8 2.1±0.4 1.1±0.3",
        ("tau_g", 0.7): "25.0±1.3 16.5±1.1 10.2±0.9 3.0±0.5 1.8±0.4",
        ("tau_inc", 0.1): "21.4±1.2 14.9±1.0 7.8±0.8 1.8±0.4 1.0±0.3",
    },
    5: {
        ("alpha_cs", 0.1): "38.5±1.4 27.6±1.3 16.2±1.1 5.8±0.7 3.3±0.5",
        ("alpha_cs", 2): "38.5±1.4 26.8±1.3 17.4±1.1 6.4±0.7 3.3±0.5",
        ("alpha_d", 0.0001): "36.2±1.4 26.2±1.3 15.6±1.0 5.0±0.6 2.4±0.4",
        ("alpha_d", 0.01): "38.5±1.4 28.3±1.3 17.3±1.1 5.8±0.7 3.0±0.5",
        ("tau_g", 0.3): "34.7±1.4 26.2±1.3 14.8±1.0 4.7±0.6 1.8±0.4",
        ("tau_g", 0.7): "36.6±1.4 25.0±1.3 15.9±1.1 5.2±0.6 2.5±0.5",
        ("tau_inc", 0.1): "37.1±1.4 26.9±1.3 14.7±1.0 3.7±0.5 1.3±0.3",
    },
    None: {
        ("alpha_cs", 0.1): "42.0±1.4 29.8±1.3 17.1±1.1 6.1±0.7 3.3±0.5",
        ("alpha_cs", 2): "39.9±1.4 27.5±1.3 17.9±1.1 6.8±0.7 3.4±0.5",
        ("alpha_d", 0.0001): "38.5±1.4 27.6±1.3 16.3±1.1 5.3±0.6 2.4±0.4",
        ("alpha_d", 0.01): "41.7±1.4 30.4±1.3 18.6±1.1 6.2±0.7 3.0±0.5",
        ("tau_g", 0.3): "38.4±1.4 28.6±1.3 16.2±1.1 4.9±0.6 1.8±0.4",
        ("tau_g", 0.7): "38.1±1.4 25.7±1.3 16.3±1.1 5.4±0.7 2.6±0.5",
        ("tau_inc", 0.1): "39.8±1.4 28.2±1.3 15.5±1.0 3.8±0.5 1.3±0.3",
    },
}


def _sweep(number: int, picks: int | None) -> Table:
    """Tables 6 to 8: one setting of Table 3 changed at a time; the default is HELIOS itself."""
    rows = []
    for key, name in _SWEEP_NAMES.items():
        figures = {k[1]: _figures(v) for k, v in _SWEEPS[picks].items() if k[0] == key}
        figures[DEFAULTS[key]] = HELIOS[picks]
        rows += [
            Row(
                f"{name} = {value:g}",
                figures[value],
                name,
                "helios-paper",
                picks=picks,
                setting=(key, value),
            )
            for value in sorted(figures)
        ]
    return Table(number, f"sensitivity, {picks_name(picks)}", "ovmm", OVMM, tuple(rows))


SWEEPS = (_sweep(6, 1), _sweep(7, 5), _sweep(8, None))


@dataclass(frozen=True)
class Relation:
    """Ratio of two published values. Ratios may be compared with ours, the values may not."""

    claim: str
    where: str
    benchmark: str
    metric: str
    top: tuple[str, str]  # agent, semantics
    bottom: tuple[str, str]
    published: float


def _ratio(metric: str, top: Mapping[str, Figure], bottom: Mapping[str, Figure]) -> float:
    return top[metric].mean / bottom[metric].mean


_T2 = {row.agent: row.figures for row in TABLE_2.rows}
_GT = {row.agent: row.figures for row in TABLE_4.rows if row.semantics == "ground-truth"}
_NOISY, _TRUE = "noisy", "ground-truth"


def _of(
    metric: str,
    claim: str,
    where: str,
    top: tuple[str, str],
    bottom: tuple[str, str],
    top_figures: Mapping[str, Figure],
    bottom_figures: Mapping[str, Figure],
    benchmark: str = "ovmm",
) -> Relation:
    published = _ratio(metric, top_figures, bottom_figures)
    return Relation(claim, where, benchmark, metric, top, bottom, published)


# The shares of FindObj and Pick that noise leaves to the trusting agent set the noise's severity
# (`studies.noise_severity`), so they are no result and stand in no row.
RELATIONS: tuple[Relation, ...] = (
    *(
        _of(m, "HELIOS over the trusting agent", "Table 1", ("helios-paper", _NOISY),
            ("trusting", _NOISY), HELIOS[None], TRUSTING[None])
        for m in ("FindObj", "Pick", "SR")
    ),
    *(
        _of(m, "HELIOS over HELIOS without global search objective", "Table 1",
            ("helios-paper", _NOISY), ("no-global-objective", _NOISY),
            HELIOS[None], NO_GLOBAL[None])
        for m in ("FindObj", "Pick", "SR")
    ),
    *(
        _of(m, "trusting agent, noisy over ground-truth semantics", "Table 4",
            ("trusting", _NOISY), ("trusting", _TRUE), TRUSTING[None], _GT["trusting"])
        for m in ("FindRec", "SR")
    ),
    *(
        _of(m, "HELIOS, noisy over ground-truth semantics", "Table 4",
            ("helios-paper", _NOISY), ("helios-paper", _TRUE), HELIOS[None], _GT["helios-paper"])
        for m in ("FindObj", "Pick", "SR")
    ),
    _of("SR", "HELIOS over the trusting agent, both with ground-truth semantics", "Table 4",
        ("helios-paper", _TRUE), ("trusting", _TRUE), _GT["helios-paper"], _GT["trusting"]),
    *(
        _of(m, "VLFM with the stop decision of HELIOS over VLFM", "Table 2",
            ("vlfm-helios-stop", _NOISY), ("vlfm", _NOISY), _T2["vlfm-helios-stop"], _T2["vlfm"],
            benchmark="objectnav")
        for m in OBJECTNAV
    ),
)  # fmt: skip

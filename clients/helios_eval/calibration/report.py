"""Writer of the calibration report: `calibration.md`, `calibration.json` and the charts."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput

from helios_eval.calibration.report_figures import Figure, figures
from helios_eval.calibration.summary import FEWEST_EPISODES, MIN_SAMPLES, RESAMPLES
from helios_eval.episodes.episode_record import EPISODES, EpisodeRecord, read

REPORT = "calibration.md"

_INTRO = """# Does the uncertainty mean anything?

Every instance of the object map says how sure it is of its class: the class score S, its
uncertainty U (both section 3.1.3), and Ψ = S − α U (eq. 7). Here they are held against the truth of
the simulator.

- **Right** is an instance whose centre lies in the box of a true thing of its class, grown by
  0.10 m (objects), or over the footprint of a true receptacle of its class, grown by 0.15 m.
- **A sample** is {sample}.
- **ECE**: expected calibration error over ten bins of equal width (adaptive: of equal counts);
  **MCE**: the widest gap of a bin. **By chance**: 95 % of perfectly calibrated scores would show an
  ECE below this, so a smaller one cannot be told from 0.
- **Brier** = reliability − resolution + uncertainty + within the bins.
- **AUROC**: the chance that a right belief scores higher than a wrong one; 0.5 is a coin.
- **Intervals** are 95 %, by {resamples} resamples of whole episodes, where there are at least
  {fewest_episodes}; those of shares are Wilson's.
- Groups of fewer than {fewest} samples are left out.

{episodes} episodes with beliefs, from: {folders}.
"""
_LAST = (
    "the last recorded belief about one instance in one episode: what the map had come to believe "
    "when the episode ended, or when the instance was picked up or given up"
)
_EVERY = "every recorded belief: instances that stay long in the map weigh more"


def read_all(folders: Sequence[Path]) -> list[EpisodeRecord]:
    """Episodes of all folders. Raises InvalidInput for an empty folder or a repeated episode."""
    where: dict[str, Path] = {}
    out: list[EpisodeRecord] = []
    for folder in folders:
        records = read(folder)
        if not records:
            raise InvalidInput(
                f"{folder} holds no episodes ({EPISODES}); give folders that `helios eval` wrote"
            )
        for record in records:
            if record.key in where:
                raise InvalidInput(
                    f"seed {record.seed} of {record.agent} lies in {where[record.key]} and in "
                    f"{folder} with the same setting; leave one of the folders out"
                )
            where[record.key] = folder
        out += records
    return out


def write(folders: Sequence[Path], out: Path, every_step: bool) -> Path:
    """Write the report on the episodes of these folders; return the path of its Markdown file.

    Raises InvalidInput if no group has enough beliefs.
    """
    records = [record for record in read_all(folders) if record.beliefs]
    made = figures(records, every_step)
    if not made:
        raise InvalidInput(
            f"no group has {MIN_SAMPLES} beliefs ({len(records)} episodes have any); run more "
            "episodes, of an agent with an object map"
        )
    out.mkdir(parents=True, exist_ok=True)
    for former in out.glob("calibration-[0-9][0-9]-*.png"):
        former.unlink()
    parts = [
        _INTRO.format(
            sample=_EVERY if every_step else _LAST,
            resamples=RESAMPLES,
            fewest=MIN_SAMPLES,
            fewest_episodes=FEWEST_EPISODES,
            episodes=len(records),
            folders=", ".join(f"`{f}`" for f in folders),
        )
    ]
    for k, figure in enumerate(made, 1):
        name = f"calibration-{k:02d}-{_slug(figure.title)}.png"
        write_file(out / name, figure.png)
        parts.append(_section(figure, name))
    numbers = [{"title": f.title, "caption": f.caption, "rows": f.table} for f in made]
    write_file(out / "calibration.json", json.dumps(numbers, indent=1, ensure_ascii=False) + "\n")
    path = out / REPORT
    write_file(path, "\n".join(parts))
    return path


def _section(figure: Figure, picture: str) -> str:
    return (
        f"## {figure.title}\n\n![{figure.title}]({picture})\n\n{figure.caption}\n\n"
        f"<details><summary>Numbers</summary>\n\n{markdown_table(figure.table)}\n</details>\n"
    )


def markdown_table(rows: Iterable[Mapping[str, object]]) -> str:
    """Markdown table with the columns of the first row; a dash for a missing value."""
    rows = list(rows)
    names = list(rows[0])
    lines = [" | ".join(names), " | ".join("---" for _ in names)]
    lines += [" | ".join(_cell(row[name]) for name in names) for row in rows]
    return "\n".join(f"| {line} |" for line in lines) + "\n"


def _cell(value: object) -> str:
    if value is None:
        return "–"
    text = f"{value:.3f}" if isinstance(value, float) else str(value)
    return text.replace("|", "\\|").replace("\n", " ")


def _slug(title: str) -> str:
    plain = title.lower().replace("×", "x").replace("'", "")
    return re.sub(r"[^a-z0-9.]+", "-", plain).strip("-")[:60]

"""report.html of a simulated run, with its plots."""

from __future__ import annotations

import html
from collections.abc import Sequence

from sitl.run import RunLog
from sitl.scenario.build import world_spec
from sitl.scenario.schema import Scenario
from uavfollow.record.output import OutputFolder
from uavfollow.record.report import Snapshots
from uavfollow.sim.plots import plot_run, plot_top_view
from uavfollow.video.writer import write_image

LINKED = ("run.json", "steps.csv", "overlay.mp4", "link.tlog")
PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>{title}</title>
<style>body{{font:15px/1.5 system-ui,sans-serif;max-width:1080px;margin:2em auto;padding:0 1em;color:#222}}
img{{max-width:100%}}pre{{background:#f4f4f4;padding:1em;overflow:auto}}</style>
<h1>{title}</h1>
<p>{description}</p>
<pre>{numbers}</pre>
{body}
<p>Files: {links}</p>
<p>Thick box: the estimate, coloured by status; thin white box: what is visible of the target in truth; circle: where
the centre is to two sigma while it is not seen. The truth is drawn and measured; it never reaches the application.</p>
</html>
"""


def write_sim_report(
    folder: OutputFolder, scenario: Scenario, seed: int, log: RunLog, lines: Sequence[str], snapshots: Snapshots
) -> None:
    """Write report.html and its pictures into the folder."""
    title = f"{scenario.name}, seed {seed}"
    body = []
    sheet = snapshots.sheet()
    if sheet is not None:
        write_image(folder.path("snapshots.jpg"), sheet)
        body.append('<img src="snapshots.jpg" alt="snapshots">')
    if log.steps:
        plot_run(
            folder.path("timeline.png"), log.steps, log.happenings, log.begin_s, scenario.guidance.standoff_m, title
        )
        plot_top_view(folder.path("top_view.png"), log.steps, world_spec(scenario, seed), title)
        body += ['<img src="timeline.png" alt="errors and commands over time">']
        body += ['<img src="top_view.png" alt="both ways from above">']
    links = [n for n in LINKED if (folder.work / n).exists() or n == "link.tlog"]
    page = PAGE.format(
        title=html.escape(title),
        description=html.escape(scenario.description),
        numbers=html.escape("\n".join(lines)),
        body="\n".join(body),
        links=", ".join(f'<a href="{n}">{n}</a>' for n in links),
    )
    folder.path("report.html").write_text(page, encoding="utf-8")

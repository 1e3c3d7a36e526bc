"""The style and the script of the pages that people read."""

from typing import Final

STYLE: Final = """
:root {
  color-scheme: light dark;
  --paper: #fbfbf9; --card: #fff; --ink: #1d1f22; --dim: #5a6069; --rule: #d9dade;
  --swapped: #3a86c8; --covered: #eeb54a; --left: #c2418a; --on-covered: #5e3d00; --on-left: #fff;
  --curve: #5a6069; --good: #1c6b3c; --fair: #8a5a00; --bad: #a3182b;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #16181b; --card: #1f2226; --ink: #e9eaec; --dim: #a3a9b2; --rule: #3a3f46;
    --swapped: #4c93d2; --covered: #d79a2b; --left: #d965a5; --on-covered: #2b1c00; --on-left: #1c0210;
    --curve: #a3a9b2; --good: #6fcf97; --fair: #eebb5c; --bad: #ff8592;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif;
}
main { max-width: 62rem; margin: 0 auto; padding: 1.5rem 1rem 4rem; overflow-wrap: break-word; }
h1 { font-size: 1rem; font-weight: 600; color: var(--dim); margin: 0; }
h2 { font-size: 1.25rem; margin: 2.5rem 0 .75rem; }
h3 { font-size: 1.05rem; margin: 0; }
p { margin: .5rem 0; }
.name, dd { overflow-wrap: anywhere; }
.name { font-size: 1.6rem; font-weight: 600; line-height: 1.25; margin: .15rem 0 1rem; }
.verdict { border-left: .4rem solid; padding: .75rem 1rem; background: var(--card); border-radius: .3rem; }
.verdict strong { display: block; font-size: 1.3rem; line-height: 1.3; }
.verdict p { margin: .25rem 0 0; color: var(--ink); }
.good { color: var(--good); } .fair { color: var(--fair); } .bad { color: var(--bad); }
.dim { color: var(--dim); }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .25rem 1.25rem; margin: 1rem 0; }
dt { color: var(--dim); } dd { margin: 0; }
code { font: .85em ui-monospace, "SF Mono", Consolas, monospace; }
.card { background: var(--card); border: 1px solid var(--rule); border-radius: .5rem; padding: 1rem; margin: 0 0 1rem; }
.facts { color: var(--dim); margin: .15rem 0 .75rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .35rem .9rem .35rem 0; border-bottom: 1px solid var(--rule); vertical-align: top; }
thead th { color: var(--dim); font-weight: 500; }
td.number, th.number { text-align: right; white-space: nowrap; }
td.text { min-width: 10rem; max-width: 24rem; overflow-wrap: anywhere; }
figure { margin: 0; }
svg { display: block; width: 100%; }
svg.key { display: inline-block; width: 1.6rem; height: 1rem; vertical-align: -.15rem; margin-right: .45rem; }
svg.defs { position: absolute; width: 0; height: 0; }
.timeline svg { height: 5rem; border-radius: .2rem; cursor: crosshair; touch-action: pan-y; }
.bar svg { height: 1.75rem; border-radius: .2rem; margin-bottom: .75rem; }
.ground { fill: var(--rule); fill-opacity: .35; }
.base-swapped { fill: var(--swapped); } .base-covered { fill: var(--covered); } .base-left { fill: var(--left); }
.mark-covered { stroke: var(--on-covered); stroke-width: 2; } .mark-left { fill: var(--on-left); }
.swapped { fill: url(#swapped); } .covered { fill: url(#covered); } .left { fill: url(#left); }
.curve { fill: var(--curve); fill-opacity: .45; }
.half { stroke: var(--rule); stroke-dasharray: 4 4; vector-effect: non-scaling-stroke; }
.cursor { stroke: var(--ink); stroke-width: 1.5; vector-effect: non-scaling-stroke; visibility: hidden; }
.timeline.read .cursor { visibility: visible; }
.axis { display: flex; justify-content: space-between; color: var(--dim); font-size: .8rem; margin-top: .2rem; }
.readout { min-height: 1.5em; margin: .15rem 0 0; font-size: .9rem; font-variant-numeric: tabular-nums; }
:focus-visible { outline: 3px solid var(--swapped); outline-offset: 2px; }
.legend { display: flex; flex-wrap: wrap; gap: .35rem 1.5rem; padding: 0; margin: 0 0 1rem; list-style: none; }
.thumbs { display: flex; flex-wrap: wrap; gap: .5rem; margin: .75rem 0 0; padding: 0; list-style: none; }
.thumbs img { display: block; height: 6rem; width: auto; max-width: 100%; border-radius: .3rem; }
details { margin-top: .75rem; } summary { cursor: pointer; }
.sign { display: grid; grid-template-columns: 2fr 1fr 2fr; gap: 1.5rem; margin-top: 3.5rem; }
.sign p { border-top: 1px solid var(--ink); margin: 0; padding-top: .25rem; color: var(--dim); }
footer { margin-top: 2.5rem; color: var(--dim); font-size: .9rem; }
a { color: inherit; }
@media (max-width: 34rem) {
  dl { grid-template-columns: 1fr; gap: 0; } dd { margin-bottom: .5rem; }
  .sign { grid-template-columns: 1fr; gap: 3rem; }
  .thumbs img { height: 4.6rem; }
  th, td { padding-right: .6rem; }
}
@media print {
  :root {
    color-scheme: light;
    --paper: #fff; --card: #fff; --ink: #000; --dim: #444; --rule: #bbb;
    --swapped: #3a86c8; --covered: #eeb54a; --left: #c2418a; --on-covered: #5e3d00; --on-left: #fff;
    --curve: #555; --good: #1c6b3c; --fair: #8a5a00; --bad: #a3182b;
  }
  @page { margin: 16mm; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  body { font-size: 10.5pt; } main { max-width: none; padding: 0; }
  .card, .sign, .verdict, tr { break-inside: avoid; } h2, h3 { break-after: avoid; }
  .readout, .hint, .cursor, details:not([open]) { display: none; }
  .scroll { overflow: visible; }
}
"""

# Says frame, time, what was done and confidence where the pointer or, by arrow keys, the cursor is on a timeline.
SCRIPT: Final = """
const words = {s: "swapped", c: "covered", l: "left as it is", "-": "not in the picture"};
const times = document.querySelector("main").dataset.times.split(" ");
const frames = Number(document.querySelector("main").dataset.frames);
for (const figure of document.querySelectorAll(".timeline")) {
  const svg = figure.querySelector("svg"), cursor = figure.querySelector(".cursor");
  const readout = figure.querySelector(".readout");
  const done = figure.dataset.done, confidence = figure.dataset.confidence.split(" "), n = done.length;
  let at = Math.max(0, done.search(/[scl]/));
  const show = (k) => {
    at = Math.min(n - 1, Math.max(0, k));
    const first = Math.ceil(at * frames / n), last = Math.ceil((at + 1) * frames / n) - 1;
    const seen = done[at] === "-" ? "" : `, confidence ${confidence[at]} %`;
    const place = first < last ? `frames ${first} to ${last}` : `frame ${first}`;
    readout.textContent = `${times[at]}, ${place}: ${words[done[at]]}${seen}`;
    for (const end of ["x1", "x2"]) cursor.setAttribute(end, (at + 0.5) * 1000 / n);
    figure.classList.add("read");
    svg.setAttribute("aria-valuenow", first);
    svg.setAttribute("aria-valuetext", readout.textContent);
  };
  const steps = {ArrowLeft: -1, ArrowRight: 1, PageUp: -(n / 20 | 0), PageDown: n / 20 | 0, Home: -n, End: n};
  svg.tabIndex = 0;
  svg.setAttribute("role", "slider");
  svg.setAttribute("aria-valuemin", 0);
  svg.setAttribute("aria-valuemax", frames - 1);
  svg.setAttribute("aria-valuenow", 0);
  svg.setAttribute("aria-valuetext", "arrow keys move through the video");
  svg.addEventListener("pointermove", (event) => {
    const box = svg.getBoundingClientRect();
    show(Math.floor((event.clientX - box.left) / box.width * n));
  });
  svg.addEventListener("focus", () => show(at));
  svg.addEventListener("keydown", (event) => {
    const step = steps[event.key];
    if (step === undefined) return;
    event.preventDefault();
    show(at + step);
  });
}
"""

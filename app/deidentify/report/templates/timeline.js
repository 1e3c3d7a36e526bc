// Shows time, frames, what was done and the confidence at the pointer or, with the arrow keys, at the cursor.
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

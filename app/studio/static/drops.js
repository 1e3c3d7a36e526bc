// Files that are dropped on a page, or pasted, go to an upload field: data-drop of an element names it.
"use strict";

const guiseDrops = {
  zones: () => [...document.querySelectorAll("[data-drop]")].filter((zone) => zone.offsetParent),

  // The zone at an event; anywhere else on a page with a single zone, that one.
  at(event) {
    const zones = this.zones();
    return event.target?.closest?.("[data-drop]") ?? (zones.length === 1 ? zones[0] : undefined);
  },

  // Pasted pictures go where the pointer or the focus is, otherwise to the first zone.
  forPaste() {
    const zones = this.zones();
    return document.activeElement.closest("[data-drop]") ?? zones.find((zone) => zone.matches(":hover")) ?? zones[0];
  },

  show(zone) {
    document.querySelectorAll(".dropping").forEach((one) => one !== zone && one.classList.remove("dropping"));
    zone?.classList.add("dropping");
  },

  take(zone, files) {
    if (zone && files.length) getElement(Number(zone.dataset.drop)).$refs.qRef.addFiles([...files]);
  },
};

addEventListener("dragover", (event) => {
  if (!event.dataTransfer.types.includes("Files")) return;
  event.preventDefault(); // or the browser would open the file instead of the page
  guiseDrops.show(guiseDrops.at(event));
});
addEventListener("dragleave", (event) => { if (!event.relatedTarget) guiseDrops.show(); });
addEventListener("drop", (event) => {
  if (!event.dataTransfer.types.includes("Files")) return;
  event.preventDefault();
  guiseDrops.show();
  guiseDrops.take(guiseDrops.at(event), event.dataTransfer.files);
});
addEventListener("paste", (event) => guiseDrops.take(guiseDrops.forPaste(), event.clipboardData.files));

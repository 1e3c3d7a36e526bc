// Shows an expression of the heads in a NiceGUI scene.
"use strict";

const guiseHeads = {
  // scene: id of the scene; ids: of its heads; shape: index of the morph target, negative for rest; amount: of it.
  // Heads load in the background, so that it tries again until they are there.
  show(scene, ids, shape, amount, tries = 100) {
    const objects = getElement(scene)?.objects;
    this.light(scene);
    const heads = ids.map((id) => objects?.get(id)?.mesh).filter(Boolean);
    heads.forEach((head) => head.traverse((part) => {
      part.morphTargetInfluences?.fill(0);
      if (part.morphTargetInfluences && shape >= 0) part.morphTargetInfluences[shape] = amount;
    }));
    if (heads.length < ids.length && tries) setTimeout(() => this.show(scene, ids, shape, amount, tries - 1), 100);
  },

  // Shows the points of an object also where others hide them, once it is there.
  seeThrough(scene, id, tries = 100) {
    const mesh = getElement(scene)?.objects?.get(id)?.mesh;
    if (mesh) {
      mesh.material.depthTest = mesh.frustumCulled = false;
      mesh.renderOrder = 1;
    } else if (tries) setTimeout(() => this.seeThrough(scene, id, tries - 1), 100);
  },

  // Studio lighting: shadows reveal the shape.
  light(scene) {
    getElement(scene)?.objects?.get("scene").mesh.traverse((light) => {
      if (light.isAmbientLight) light.intensity = 0.6;
      if (light.isDirectionalLight) { light.intensity = 2.2; light.position.set(-4, -6, 5); }
    });
  },

  // A drag turns a scene's heads; the click at its end is none.
  still(scene) {
    const place = getHtmlElement(scene);
    let from;
    place.parentElement.addEventListener("pointerdown", (event) => { from = event; }, true);
    place.parentElement.addEventListener("click", (event) => {
      if (Math.hypot(event.clientX - from.clientX, event.clientY - from.clientY) > 4) event.stopPropagation();
    }, true);
  },
};

// Drives a head in a NiceGUI scene by the coefficients and rotations that the studio sends: see rig_run.py.
"use strict";

const WEIGHTS = 52;
const DRAWINGS = 2; // after a change: what is new may come to the graphics card with the first
const LATE_SECONDS = 0.25; // of a clip beside the head, after which it is put right

const guiseRig = {
  morphs: [], // of the head: a part, and for each of its morph targets the coefficients that move it, with their weights
  turned: [], // what of it turns: a part, which of head and eyes it is, its rest, what is above it, and about what

  drawings: 0, // that are due, as something has changed

  // Has a scene drawn only when something has changed: its own loop would draw a head at rest all the time.
  rest(scene) {
    const { renderer, controls } = getElement(scene), draw = renderer.render.bind(renderer);
    renderer.render = (...what) => { if (this.drawings > 0) { this.drawings--; draw(...what); } };
    controls.addEventListener("change", () => this.change());
    new ResizeObserver(() => this.change()).observe(renderer.domElement);
    this.change();
  },

  change() { this.drawings = DRAWINGS; },

  // Takes a head of a scene, both by their ids, when it has loaded, in place of the one before.
  // centre : about which a head turns that has no node for it.
  async use(scene, head, centre) {
    this.morphs = this.turned = [];
    const object = await loaded(scene, head);
    if (!object) return;
    const morphs = [], turned = [];
    object.traverse((part) => {
      const { guiseShapes: shapes, guiseNode: which } = part.userData;
      if (part.morphTargetInfluences && shapes) morphs.push({ part, shapes });
      if (part.isMesh) part.frustumCulled = false; // three.js knows only the bounds at rest
      if (which !== undefined) turned.push({ part, which, rest: part.quaternion.clone(), above: above(part, object) });
    });
    if (!turned.some(({ which }) => which === 0)) turned.push(whole(object.children[0], centre));
    [this.morphs, this.turned] = [morphs, turned];
    this.change();
  },

  // What shows the studio's messages.   video : in which a clip plays along, if there is one, by its url.
  showing(video, url) {
    if (url) video.src = url;
    return (data) => {
      if (url) this.follow(video, new DataView(data).getFloat64(12, true));
      this.show(new Float32Array(data, HEADER_BYTES));
    };
  },

  show(values) {
    if (!values.length) return; // no face is seen
    for (const { part, shapes } of this.morphs) {
      shapes.forEach((moved, k) => {
        part.morphTargetInfluences[k] = moved.reduce((sum, [place, weight]) => sum + weight * values[place], 0);
      });
    }
    for (const { part, which, rest, above, centre } of this.turned) {
      const turn = rest.clone().fromArray(values, WEIGHTS + 4 * which);
      part.quaternion.copy(above).invert().multiply(turn).multiply(above).multiply(rest);
      if (centre) part.position.copy(centre).applyQuaternion(part.quaternion).negate().add(centre);
    }
    this.meters?.forEach((meter, k) => { meter.value = values[k]; });
    this.drawings = Math.max(this.drawings, 1);
  },

  follow(video, seconds) {
    if (!video.readyState) return;
    if (Math.abs(video.currentTime - seconds) > LATE_SECONDS) video.currentTime = seconds;
    if (video.paused && !video.ended) video.play().catch(() => {});
  },

  end(video) {
    video.removeAttribute("src");
    video.load();
  },
};

async function loaded(scene, head) {
  for (let tries = 0; tries < 600; tries++) {
    const object = getElement(scene)?.objects?.get(head)?.mesh;
    if (object) return object;
    await new Promise((done) => setTimeout(done, 50));
  }
}

// The rotation of what a part is in, within an object.
function above(part, object) {
  const found = part.quaternion.clone().identity();
  for (let one = part.parent; one && one !== object; one = one.parent) found.premultiply(one.quaternion);
  return found;
}

function whole(part, centre) {
  const rest = part.quaternion.clone();
  return { part, which: 0, rest, above: rest.clone().identity(), centre: part.position.clone().fromArray(centre) };
}

// The browser's end of the studio's live connection: a websocket with pictures as they are, without a codec.
"use strict";

const HEADER_BYTES = 24; // as in frame_socket.py: format, width, height, matrix, whether full range, time, number
const FORMATS = ["I420", "NV12", "RGBA", "RGBX", "BGRA", "BGRX"]; // sent as they come; others are converted
const BT709 = 1, BT601 = 5; // matrices

const guiseLive = {
  most: 2, // pictures that the studio may have at once: it works on one while the next one waits
  patience: 1000, // ms without a picture, after which another one is sent all the same
  pause: 150, // ms between two pictures of the inset; at the camera's rate it costs as much as the result

  // Opens camera, microphone and connection; own and result are video elements, lines those that a picture should have.
  // Without own, the studio has another camera.  The answer's "silent" says that the sound that is wanted is missing.
  // show : takes what comes back, if that is no pictures for result.
  async begin(own, result, address, withSound, lines, show) {
    this.end();
    const session = this.session = { own, result, out: [], count: 0, returned: 0, glanced: -Infinity };
    try {
      if (!window.VideoFrame) throw new DOMException("", "NotSupportedError");
      await this.open(session, own, withSound, lines);
      session.show = show ?? this.pictures(result);
      session.socket = await connected(address);
      session.socket.onmessage = ({ data }) => this.take(session, data);
      session.socket.onclose = () => { if (this.session === session) this.end(); };
      const [camera] = session.stream.getVideoTracks();
      if (camera) this.read(session, camera);
      return { silent: withSound && !session.stream.getAudioTracks().length ? "yes" : "" };
    } catch (error) {
      this.end();
      return { error: error.name };
    }
  },

  // A camera's own modes only, wide ones first: a browser crops or scales to what it is asked for.
  async open(session, own, withSound, lines) {
    const wide = { aspectRatio: { ideal: 16 / 9 }, height: { ideal: lines }, resizeMode: { ideal: "none" } };
    const video = own && { ...wide, frameRate: { ideal: 30 } };
    session.stream = video || withSound ? await allowed(video, withSound) : new MediaStream();
    const [camera] = session.stream.getVideoTracks();
    if (!camera) return;
    camera.onended = () => emitEvent("live-camera-ended");
    if (window.MediaStreamTrackProcessor) session.glance = drawing(own);
    else own.srcObject = new MediaStream([camera]);
  },

  // Offers every picture of the camera, also while the page is in the background, where the browser is able to.
  async read(session, camera) {
    if (window.MediaStreamTrackProcessor) {
      const reader = new MediaStreamTrackProcessor({ track: camera }).readable.getReader();
      for (let next = await reader.read(); !next.done; next = await reader.read()) await this.offer(session, next.value);
      return;
    }
    const next = async (now) => {
      if (this.session !== session) return;
      const frame = shown(session.own, now);
      if (frame) await this.offer(session, frame);
      session.own.requestVideoFrameCallback(next);
    };
    session.own.requestVideoFrameCallback(next);
  },

  // Sends a picture, unless the studio still has as many as it may; a few are shown in the inset, too.
  async offer(session, frame) {
    const number = session.count++, now = performance.now();
    if (this.session === session && session.glance && now - session.glanced > this.pause) {
      session.glanced = now;
      session.glance(frame.clone());
    }
    const late = now - session.returned > this.patience;
    if (this.session === session && (session.out.length < this.most || late)) {
      session.out.push(number);
      session.returned = late ? performance.now() : session.returned;
      const message = await packed(frame, number);
      this.send(session, message);
    }
    frame.close();
  },

  // Nothing goes out once the other end has hung up, which is known here only a little later.
  send(session, message) {
    const open = session.socket.readyState === WebSocket.OPEN;
    if (this.session === session && open) session.socket.send(message);
  },

  // Shows what has come back, which has the number of a picture that was sent.
  take(session, data) {
    const number = new DataView(data).getUint32(20, true);
    session.out = session.out.filter((one) => one > number);
    session.returned = performance.now();
    session.show(data);
  },

  // What shows pictures in a video element.
  pictures(video) {
    const draw = drawing(video);
    return (data) => {
      const head = new DataView(data);
      const [width, height, matrix, full] = [4, 6, 8, 10].map((at) => head.getUint16(at, true));
      const colorSpace = { primaries: "bt709", transfer: "bt709", matrix: matrix === BT709 ? "bt709" : "smpte170m" };
      draw(new VideoFrame(new Uint8Array(data, HEADER_BYTES), {
        format: "I420", codedWidth: width, codedHeight: height, timestamp: Math.round(1000 * performance.now()),
        colorSpace: { ...colorSpace, fullRange: Boolean(full) },
      }));
      this.follow();
    };
  },

  // Shows the result alone in a window of its own, by whose title other programs capture it.
  popOut(id) {
    const result = getHtmlElement(id);
    const [width, height] = [result.videoWidth || 1280, result.videoHeight || 720];
    const page = window.open("", "guise-result", `popup,width=${width},height=${height}`)?.document;
    if (!page) return;
    page.title = "Guise result";
    page.body.style = "margin: 0; background: #000";
    const video = Object.assign(page.createElement("video"), { autoplay: true, muted: true, playsInline: true });
    video.style = "display: block; width: 100vw; height: 100vh; object-fit: contain";
    page.body.replaceChildren(video);
    this.popped = { video, result };
    this.follow();
  },

  // Keeps the window of its own, if there is one, on what the page shows.
  follow() {
    if (!this.popped) return;
    const { video, result } = this.popped;
    if (!video.ownerDocument.defaultView) this.popped = undefined;
    else if (video.srcObject !== result.srcObject) video.srcObject = result.srcObject;
  },

  // Changes an element at once: a change through NiceGUI renders the whole page anew.
  write(id, text) { getHtmlElement(id).textContent = text; },
  outline(id, path, width, height) {
    const line = getHtmlElement(id);
    line.setAttribute("d", path);
    line.ownerSVGElement.setAttribute("viewBox", `0 0 ${width} ${height}`);
  },

  fillScreen(id) {
    if (document.fullscreenElement) document.exitFullscreen();
    else getHtmlElement(id).requestFullscreen();
  },

  // Sends the microphone's sound from now on; tells whether there is a microphone.
  async listen() {
    const session = this.session;
    const [microphone] = session?.stream.getAudioTracks() ?? [];
    if (!microphone || session.sound) return Boolean(microphone);
    const { sampleRate } = microphone.getSettings(); // some browsers connect a microphone to a context of its rate only
    const sound = session.sound = new AudioContext(sampleRate ? { sampleRate } : {});
    await sound.audioWorklet.addModule("/static/microphone.js");
    const stereo = { channelCount: 2, channelCountMode: "explicit", numberOfOutputs: 0 };
    const blocks = new AudioWorkletNode(sound, "blocks", stereo);
    sound.createMediaStreamSource(new MediaStream([microphone])).connect(blocks);
    blocks.port.onmessage = ({ data: { position, block } }) => {
      const message = new Uint8Array(HEADER_BYTES + block.byteLength);
      header(message, "PCM ", 0, 0, 0, 0, 0, position);
      message.set(new Uint8Array(block.buffer), HEADER_BYTES);
      this.send(session, message);
    };
    return true;
  },

  async deafen() {
    await this.session?.sound?.close();
    if (this.session) this.session.sound = undefined;
  },

  end() {
    const session = this.session;
    this.session = undefined;
    if (!session) return;
    session.stream?.getTracks().forEach((track) => track.stop());
    session.socket?.close();
    if (session.sound?.state !== "closed") session.sound?.close();
    for (const video of [session.own, session.result]) if (video) video.srcObject = null;
    this.follow();
  },
};

// Camera and microphone; a microphone that is missing or not allowed leaves the camera.
async function allowed(video, withSound) {
  const devices = navigator.mediaDevices;
  const sound = { channelCount: 2, echoCancellation: false };
  try {
    return await devices.getUserMedia({ video: video || false, audio: withSound && sound });
  } catch (error) {
    if (!withSound) throw error;
    return video ? devices.getUserMedia({ video }) : new MediaStream();
  }
}

function connected(address) {
  const socket = new WebSocket(`ws://${location.host}${address}`);
  socket.binaryType = "arraybuffer";
  return new Promise((resolve, reject) => {
    socket.onopen = () => resolve(socket);
    socket.onerror = () => reject(new DOMException("", "NetworkError"));
  });
}

// What a video shows, or nothing: the first picture may be announced before there is one.
function shown(video, now) {
  try {
    return new VideoFrame(video, { timestamp: Math.round(1000 * now) });
  } catch {
    return undefined;
  }
}

// What shows pictures in a video element.
function drawing(video) {
  if (window.MediaStreamTrackGenerator) {
    const track = new MediaStreamTrackGenerator({ kind: "video" });
    const writer = track.writable.getWriter();
    video.srcObject = new MediaStream([track]);
    return (frame) => { // one that would have to wait is left out
      if (writer.desiredSize > 0) writer.write(frame).catch(() => frame.close());
      else frame.close();
    };
  }
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d", { alpha: false });
  return (frame) => {
    if (canvas.width !== frame.displayWidth || canvas.height !== frame.displayHeight) {
      [canvas.width, canvas.height] = [frame.displayWidth, frame.displayHeight];
    }
    context.drawImage(frame, 0, 0);
    frame.close();
    video.srcObject ??= canvas.captureStream();
  };
}

async function packed(frame, number) {
  const format = FORMATS.includes(frame.format) ? frame.format : "RGBA";
  const options = format === frame.format ? {} : { format };
  const message = new Uint8Array(HEADER_BYTES + frame.allocationSize(options));
  await frame.copyTo(message.subarray(HEADER_BYTES), options);
  const { width, height } = frame.visibleRect;
  const { matrix, fullRange } = frame.colorSpace;
  const colour = [matrix === "bt709" ? BT709 : BT601, Number(fullRange ?? false)];
  header(message, format, width, height, ...colour, frame.timestamp / 1e6, number);
  return message;
}

function header(message, format, width, height, matrix, full, seconds, number) {
  const head = new DataView(message.buffer);
  for (let i = 0; i < 4; i++) head.setUint8(i, format.charCodeAt(i));
  [width, height, matrix, full].forEach((value, i) => head.setUint16(4 + 2 * i, value, true));
  head.setFloat64(12, seconds, true);
  head.setUint32(20, number, true);
}

addEventListener("pagehide", () => guiseLive.end());

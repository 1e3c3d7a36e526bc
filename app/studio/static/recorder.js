// Records a clip with the browser's camera; nothing leaves the browser before the end, and sound is not recorded.
"use strict";

const guiseRecorder = {
  // Starts recording into a video element; returns "", or the name of an error.
  // The clip is handed to the upload field (a NiceGUI id) when recording stops, if video.wanted.
  async start(video, field) {
    try {
      const wanted = { width: { ideal: 1280 }, height: { ideal: 720 } };
      const stream = await navigator.mediaDevices.getUserMedia({ video: wanted });
      const pieces = [];
      const recorder = video.recorder = new MediaRecorder(stream, { videoBitsPerSecond: 8e6 });
      recorder.ondataavailable = (event) => pieces.push(event.data);
      recorder.onstop = () => {
        stream.getTracks().forEach((track) => track.stop());
        video.srcObject = null;
        const type = recorder.mimeType;
        const name = type.includes("mp4") ? "recording.mp4" : "recording.webm";
        if (video.wanted) getElement(field).$refs.qRef.addFiles([new File(pieces, name, { type })]);
      };
      video.srcObject = stream;
      recorder.start();
      return "";
    } catch (error) {
      return error.name;
    }
  },

  stop(video, wanted) {
    video.wanted = wanted;
    video.recorder.stop();
  },
};

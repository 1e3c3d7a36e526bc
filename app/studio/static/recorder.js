// Records a clip with the browser's camera; nothing leaves the browser before it is wanted, and sound is not recorded.
"use strict";

const guiseRecorder = {
  // Starts recording into a video element; returns "", or the name of an error.
  // The clip is handed to the upload field (a NiceGUI id) when it is wanted and complete.
  async start(video, field) {
    try {
      const wanted = { width: { ideal: 1280 }, height: { ideal: 720 } };
      const stream = await navigator.mediaDevices.getUserMedia({ video: wanted });
      const pieces = [];
      const recorder = video.recorder = new MediaRecorder(stream, { videoBitsPerSecond: 8e6 });
      recorder.ondataavailable = (event) => pieces.push(event.data);
      let clip = null;
      video.hand = () => {
        if (!clip || !video.wanted) return;
        video.wanted = false;
        getElement(field).$refs.qRef.addFiles([clip]);
      };
      video.wanted = false;
      recorder.onstop = () => {
        stream.getTracks().forEach((track) => track.stop());
        video.srcObject = null;
        const type = recorder.mimeType;
        clip = new File(pieces, type.includes("mp4") ? "recording.mp4" : "recording.webm", { type });
        video.hand();
      };
      video.srcObject = stream;
      recorder.start();
      return "";
    } catch (error) {
      return error.name;
    }
  },

  // Ends the recording, which waits for what the user says.
  end(video) {
    if (video.recorder.state !== "inactive") video.recorder.stop();
  },

  // Takes what was recorded, or drops it.
  choose(video, wanted) {
    video.wanted = wanted;
    video.hand();
    guiseRecorder.end(video);
  },
};

// The browser's end of the studio's video connection.
"use strict";

const guiseLive = {
  // Offers a connection; own and result are video elements.  Without own, the server's camera is used.
  // withSound: send the microphone's sound; the answer's "silent" says that there is none.
  async begin(own, result, withSound) {
    this.end();
    this.videos = [own, result];
    try {
      const connection = this.connection = new RTCPeerConnection();
      const video = connection.addTransceiver("video", { direction: own ? "sendrecv" : "recvonly" });
      video.receiver.jitterBufferTarget = 0;
      connection.ontrack = (event) => { result.srcObject = new MediaStream([event.track]); };
      const silent = await this.open(own, video.sender, withSound);
      await connection.setLocalDescription();
      await new Promise((done) => {
        connection.onicegatheringstatechange = () => connection.iceGatheringState === "complete" && done();
        if (connection.iceGatheringState === "complete") done();
        setTimeout(done, 5000); // without a network it never completes
      });
      if (!connection.localDescription.sdp.includes("a=candidate")) throw new DOMException("", "NetworkError");
      return { ...connection.localDescription.toJSON(), silent };
    } catch (error) {
      this.end();
      return { error: error.name };
    }
  },

  // Opens camera and microphone; whether the sound that is wanted is missing.
  async open(own, sender, withSound) {
    const video = own && { width: { ideal: 640 }, height: { ideal: 480 }, frameRate: { ideal: 30 } };
    this.stream = new MediaStream();
    if (video || withSound) await this.allow(video, withSound);
    const [camera] = this.stream.getVideoTracks();
    const [microphone] = this.stream.getAudioTracks();
    if (microphone) this.connection.addTransceiver(microphone, { direction: "sendonly" });
    if (camera) await this.show(own, camera, sender);
    return withSound && !microphone ? "yes" : "";
  },

  // A microphone that is missing or not allowed leaves the camera.
  async allow(video, withSound) {
    const devices = navigator.mediaDevices;
    const sound = { channelCount: 2, echoCancellation: false };
    try {
      this.stream = await devices.getUserMedia({ video: video || false, audio: withSound && sound });
    } catch (error) {
      if (!withSound) throw error;
      if (video) this.stream = await devices.getUserMedia({ video });
    }
  },

  async show(own, camera, sender) {
    camera.onended = () => emitEvent("live-camera-ended");
    own.srcObject = new MediaStream([camera]);
    await sender.replaceTrack(camera);
    const parameters = sender.getParameters();
    parameters.degradationPreference = "maintain-resolution";
    await sender.setParameters(parameters);
  },

  async accept(answer) {
    await this.connection.setRemoteDescription(answer);
  },

  end() {
    this.stream?.getTracks().forEach((track) => track.stop());
    this.connection?.close();
    this.videos?.forEach((video) => { if (video) video.srcObject = null; });
    this.stream = this.connection = this.videos = undefined;
  },
};

addEventListener("pagehide", () => guiseLive.end());

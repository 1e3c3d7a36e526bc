// The browser's end of the studio's video connection.
"use strict";

const guiseLive = {
  // Offers a connection; own and result are video elements.  Without own, the server's camera is used.
  async begin(own, result) {
    this.end();
    this.videos = [own, result];
    try {
      const connection = this.connection = new RTCPeerConnection();
      const video = connection.addTransceiver("video", { direction: own ? "sendrecv" : "recvonly" });
      video.receiver.jitterBufferTarget = 0;
      connection.ontrack = (event) => { result.srcObject = new MediaStream([event.track]); };
      if (own) await this.open(own, video.sender);
      await connection.setLocalDescription();
      await new Promise((done) => {
        connection.onicegatheringstatechange = () => connection.iceGatheringState === "complete" && done();
        if (connection.iceGatheringState === "complete") done();
        setTimeout(done, 5000); // without a network it never completes
      });
      if (!connection.localDescription.sdp.includes("a=candidate")) throw new DOMException("", "NetworkError");
      return connection.localDescription.toJSON();
    } catch (error) {
      this.end();
      return { error: error.name };
    }
  },

  async open(own, sender) {
    const wanted = { width: { ideal: 640 }, height: { ideal: 480 }, frameRate: { ideal: 30 } };
    this.stream = await navigator.mediaDevices.getUserMedia({ video: wanted });
    const [track] = this.stream.getVideoTracks();
    track.onended = () => emitEvent("live-camera-ended");
    own.srcObject = this.stream;
    await sender.replaceTrack(track);
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

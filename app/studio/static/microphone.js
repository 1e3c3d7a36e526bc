// Hands on a microphone's sound in blocks of interleaved stereo, each with the number of its first sample.
"use strict";

const BLOCK_SAMPLES = 1024;

class Blocks extends AudioWorkletProcessor {
  block = new Float32Array(2 * BLOCK_SAMPLES);
  filled = 0;

  process([[left, right]]) {
    if (!left) this.filled = 0; // nothing is connected any more, or not yet
    for (let i = 0; i < (left?.length ?? 0); i++) {
      this.block[2 * this.filled] = left[i];
      this.block[2 * this.filled++ + 1] = (right ?? left)[i];
      if (this.filled === BLOCK_SAMPLES) this.hand(currentFrame + i + 1 - BLOCK_SAMPLES);
    }
    return true;
  }

  hand(position) {
    this.port.postMessage({ position, block: this.block.slice() });
    this.filled = 0;
  }
}

registerProcessor("blocks", Blocks);

// Hands on a microphone's sound in blocks of interleaved stereo at RATE, each with the number of its first sample.
"use strict";

const BLOCK_SAMPLES = 1024;
const RATE = 48000; // Hz

class Blocks extends AudioWorkletProcessor {
  block = new Float32Array(2 * BLOCK_SAMPLES);
  filled = 0;
  before = [0, 0]; // the last sample
  at = 0; // place of the next sample at RATE: 0 at the last one, 1 at the one after it

  process([[left, right]]) {
    if (!left) this.filled = 0; // nothing is connected any more, or not yet
    for (let i = 0; i < (left?.length ?? 0); i++) {
      const now = [left[i], (right ?? left)[i]];
      for (; this.at < 1; this.at += sampleRate / RATE) {
        for (const k of [0, 1]) this.block[2 * this.filled + k] = this.before[k] + this.at * (now[k] - this.before[k]);
        if (++this.filled === BLOCK_SAMPLES) this.hand(currentFrame + i);
      }
      this.at -= 1;
      this.before = now;
    }
    return true;
  }

  // sample : of the context, number of the last one in the block.
  hand(sample) {
    const position = Math.max(0, Math.round(sample * RATE / sampleRate) + 1 - BLOCK_SAMPLES);
    this.port.postMessage({ position, block: this.block.slice() });
    this.filled = 0;
  }
}

registerProcessor("blocks", Blocks);

"""Says sentences by voices of espeak-ng, for benchmarks.deidentify.voice; run by a Python that has espeakng-loader.

Usage: python espeak.py OUTPUT.npz VOICE... < SENTENCES.  Written: rate, and for each voice and sentence VOICE.N, (n,)
int16.
"""

import ctypes
import sys

import espeakng_loader  # type: ignore[import-not-found, unused-ignore]
import numpy as np

RETRIEVAL, UTF8, ALL = 1, 1, 0


def main(output: str, voices: list[str]) -> None:
    """Say all lines of the standard input by all voices."""
    library = ctypes.CDLL(espeakng_loader.get_library_path())
    rate = library.espeak_Initialize(RETRIEVAL, 0, espeakng_loader.get_data_path().encode(), 0)
    said: list[np.ndarray] = []
    kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.c_void_p)

    @kind
    def take(samples, count, _events):  # type: ignore[no-untyped-def]
        if samples and count > 0:
            said.append(np.ctypeslib.as_array(samples, (count,)).copy())
        return 0

    library.espeak_SetSynthCallback(take)
    sentences = [line.strip() for line in sys.stdin if line.strip()]
    found = {"rate": np.array(rate)}
    for voice in voices:
        if library.espeak_SetVoiceByName(f"en+{voice}".encode()):
            raise SystemExit(f"espeak-ng has no voice {voice}")
        for number, sentence in enumerate(sentences):
            said.clear()
            text = sentence.encode()
            library.espeak_Synth(text, len(text) + 1, 0, 0, 0, UTF8, None, None)
            library.espeak_Synchronize()
            found[f"{voice}.{number}"] = np.concatenate(said)
    np.savez(output, **found)  # type: ignore[arg-type]


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])

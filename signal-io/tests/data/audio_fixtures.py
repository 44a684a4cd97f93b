"""Makes the sound files of this folder: python audio_fixtures.py (needs numpy and soundfile 0.14, which bring
libsndfile 1.2.2 with its FLAC, Vorbis and LAME encoders).

Both channels are closed forms, so that the tests need no other reference:
left  = 0.5 sin(2 pi 441 t) + 0.25 sin(2 pi 1323 t), right = 0.5 sin(2 pi 735 t), faded in and out."""
import numpy as np, soundfile as sf
rate, n = 44100, 9001
t = np.arange(n) / rate
fade = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2
left = fade * (0.5 * np.sin(2 * np.pi * 441 * t) + 0.25 * np.sin(2 * np.pi * 1323 * t))
right = fade * 0.5 * np.sin(2 * np.pi * 735 * t)
stereo = np.stack([left, right], 1)
sf.write("stereo.ogg", stereo, rate, format="OGG", subtype="VORBIS")
sf.write("stereo.mp3", stereo, rate, format="MP3", subtype="MPEG_LAYER_III")
sf.write("stereo24.flac", stereo[:2001], rate, subtype="PCM_24")
sf.write("mono16.flac", left[:3001], rate, subtype="PCM_16")

"""Writes a small vocabulary in the form of the public code's folder `glove`.

    pip install numpy
    python make.py

A word's vector is its row, then its row divided by 4. Two rows are of no word, and rows are not in the words' order.
"""

import pickle
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
WORDS = ["sos", "a", "man", "walk", "up", "happily", "eos", "unk"]
ROWS = [9, 0, 1, 2, 4, 5, 8, 7]

rows = np.arange(10, dtype=np.float64)
np.save(HERE / "our_vab_data.npy", np.stack([rows, rows / 4], axis=1))
(HERE / "our_vab_words.pkl").write_bytes(pickle.dumps(WORDS, protocol=3))
(HERE / "our_vab_idx.pkl").write_bytes(pickle.dumps(dict(zip(WORDS, ROWS)), protocol=3))

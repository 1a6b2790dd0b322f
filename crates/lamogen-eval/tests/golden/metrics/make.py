"""Writes the golden values of the metrics: `cases.json`.

    pip install numpy scipy
    python make.py

Distances of regular covariances come from `scipy.linalg.sqrtm`, as in the public evaluation code. Where there are fewer
samples than dimensions that root is not reliable; there the trace of the root is the nuclear norm of the product of the
centred samples, which needs no covariance.
"""

import json
from pathlib import Path

import numpy as np
from scipy import linalg


def statistics(x):
    return x.mean(axis=0), np.cov(x, rowvar=False)


def by_root(a, b):
    (m, s), (n, t) = statistics(a), statistics(b)
    root = linalg.sqrtm(s @ t)
    return float((m - n) @ (m - n) + np.trace(s) + np.trace(t) - 2 * np.trace(np.real(root)))


def by_samples(a, b):
    (m, s), (n, t) = statistics(a), statistics(b)
    product = (a - m) @ (b - n).T / np.sqrt((len(a) - 1) * (len(b) - 1))
    common = np.linalg.svd(product, compute_uv=False).sum()
    return float((m - n) @ (m - n) + np.trace(s) + np.trace(t) - 2 * common)


def ranks(texts, motions):
    distances = np.linalg.norm(texts[:, None] - motions[None], axis=2)
    order = np.argsort(distances, axis=1)
    found = order == np.arange(len(texts))[:, None]
    return [float(found[:, : k + 1].any(axis=1).mean()) for k in range(3)], float(np.diag(distances).mean())


def main():
    draws = np.random.default_rng(7)
    # In 32 bits, and as JSON writes them.
    def samples(count, width, scale, place):
        mixing = draws.normal(size=(width, width))
        x = draws.normal(size=(count, width)) @ mixing * scale + place
        return x.astype(np.float32).round(3).astype(np.float64)

    cases = []
    for name, sizes, width, by in [("regular", (40, 30), 5, by_root), ("singular", (6, 9), 12, by_samples)]:
        a, b = samples(sizes[0], width, 1.0, 0.0), samples(sizes[1], width, 0.7, 0.5)
        if name == "regular":
            assert abs(by_root(a, b) - by_samples(a, b)) < 1e-9
        cases.append(dict(name=name, width=width, a=a.ravel().tolist(), b=b.ravel().tolist(), fid=by(a, b)))
    texts = samples(32, 4, 1.0, 0.0)
    motions = (texts + draws.normal(size=texts.shape)).astype(np.float32).round(3).astype(np.float64)
    precision, distance = ranks(texts, motions)
    matching = dict(
        width=4, texts=texts.ravel().tolist(), motions=motions.ravel().tolist(), r_precision=precision, distance=distance
    )
    draws = np.random.default_rng(11)
    small = draws.uniform(0.5, 2.0, size=(4, 9, 4)).round(3)
    large = small * draws.uniform(0.8, 3.0, size=(4, 9, 4)).round(3)
    changes = (large - small) / small
    mean = changes.mean(axis=1)
    control = dict(
        small=small.tolist(),
        large=large.tolist(),
        mean=mean.tolist(),
        std=changes.std(axis=1).tolist(),
        diagonality=float((np.diag(mean) ** 2).sum() / (mean**2).sum()),
    )
    written = dict(fid=cases, matching=matching, control=control)
    (Path(__file__).parent / "cases.json").write_text(json.dumps(written) + "\n")


main()

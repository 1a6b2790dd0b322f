"""Writes the golden case of the public evaluation: an evaluator's folder as users have it, and `case.json`.

    pip install torch numpy scipy
    python make.py

Everything is made up: the networks are random and small, and every number of a motion is a formula of its place, so that no motion has to
be kept. The rules and the arithmetic are written down here from the description in `docs/evaluation.md`, in plain PyTorch and numpy: which
recordings and parts count, what a loader draws, how batches are formed, and each figure. The draws are recorded, so that the same ones can be
replayed.
"""

import json
import math
import pickle
import random
from pathlib import Path

import numpy as np
import torch
from scipy import linalg
from torch import nn
from torch.nn.utils.rnn import pack_padded_sequence

HERE = Path(__file__).parent
POSE, CONV, LATENT, MOTION, TEXT, SPACE, WORD = 263, 8, 10, 12, 11, 9, 7
PARTS = "VERB NOUN DET ADP NUM AUX PRON ADJ ADV Loc_VIP Body_VIP Obj_VIP Act_VIP Desc_VIP OTHER".split()
# The special words among those that are used here.
SPECIAL = {"left": "Loc_VIP", "hand": "Body_VIP", "chair": "Obj_VIP", "slowly": "Desc_VIP"}
SPECIAL |= dict.fromkeys(["walk", "turn", "sit", "jump"], "Act_VIP")
GROUPS = [1, 2, 1, 63, 126, 66, 4]
BIASED = [0, 1, 2, 6]
LONGEST, UNIT, BATCH = 196, 4, 32
REPLICATIONS, DIVERSITY_PAIRS = 3, 20
MANY_TEXTS, MANY_MOTIONS, MANY_PAIRS = 5, 6, 4


def features(seed, frames):
    """Numbers that both sides compute to the last bit: integers, then one division."""
    f = np.arange(frames, dtype=np.int64)[:, None]
    j = np.arange(POSE, dtype=np.int64)[None]
    wild = (seed * 7919 + f * 104729 + j * 1299709 + f * j * 31 + f * f * (17 + seed % 7)) % 2001
    slow = (f * (1 + (seed + j) % 5) + seed * 13) % 81
    return ((wild + 50 * slow - 3000) / 1000).astype(np.float32)


class Movement(nn.Module):
    def __init__(self):
        super().__init__()
        self.main = nn.Sequential(
            nn.Conv1d(POSE - 4, CONV, 4, 2, 1), nn.Dropout(0.2), nn.LeakyReLU(0.2),
            nn.Conv1d(CONV, LATENT, 4, 2, 1), nn.Dropout(0.2), nn.LeakyReLU(0.2),
        )
        self.out_net = nn.Linear(LATENT, LATENT)

    def forward(self, x):
        return self.out_net(self.main(x.transpose(1, 2)).transpose(1, 2))


class Recurrent(nn.Module):
    def __init__(self, width, hidden):
        super().__init__()
        self.input_emb = nn.Linear(width, hidden)
        self.gru = nn.GRU(hidden, hidden, batch_first=True, bidirectional=True)
        self.output_net = nn.Sequential(
            nn.Linear(2 * hidden, hidden), nn.LayerNorm(hidden), nn.LeakyReLU(0.2), nn.Linear(hidden, SPACE)
        )
        self.hidden = nn.Parameter(torch.randn(2, 1, hidden))

    def read(self, x, lengths):
        packed = pack_padded_sequence(self.input_emb(x), lengths, batch_first=True, enforce_sorted=False)
        _, last = self.gru(packed, self.hidden.repeat(1, len(lengths), 1))
        return self.output_net(torch.cat([last[0], last[1]], dim=-1))


class TextEncoder(Recurrent):
    def __init__(self):
        super().__init__(WORD, TEXT)
        self.pos_emb = nn.Linear(len(PARTS), WORD)


def recordings(draws):
    """Names with lengths and caption files: usual ones, and every special case of the data."""
    subjects = ["a/DET man/NOUN", "someone/PRON", "the/DET figure/NOUN"]
    actions = ["walk/VERB", "wave/VERB a/DET hand/NOUN", "turn/VERB left/ADV", "sit/VERB on/ADP a/DET chair/NOUN"]
    ends = ["", " slowly/ADV", " and/CCONJ then/ADV jump/VERB", " zigzag/NOUN"]

    def line(start=0.0, end=0.0):
        tokens = draws.choice(subjects) + " " + draws.choice(actions) + draws.choice(ends)
        if draws.random() < 0.1:
            tokens += " and/CCONJ walk/VERB" * 12
        text = " ".join(token.split("/")[0] for token in tokens.split())
        return f"{text}.#{tokens}#{start}#{end}\n"

    found = []
    for index in range(40):
        name = ("M" if index % 5 == 4 else "") + f"{index:06}"
        frames = draws.randint(40, 199)
        text = "".join(line() for _ in range(draws.randint(1, 4)))
        if index % 2:
            start = draws.randint(0, 3)
            text += line(float(start), start + draws.choice([1.9, 2.0, 2.5, 3.3, 30.0]))
        if index % 3 != 1:
            text = line(0.0, draws.choice([2.0, 2.45, 4.0])) + text
        found.append([name, frames, text])
    found[1][1], found[3][1], found[5][1], found[7][1] = 39, 200, 40, 199
    found[9][2] = line(0.5, 3.0)
    found[11][2] = line() + line(1.0, 3.0) + "he # waves#he/PRON wave/VERB#0.0#0.0\n" + line()
    found[13][2] = line().replace("#0.0#0.0", "#nan#nan")
    return found


def counted(files):
    """The motions that the public loader keeps: name, recording, first frame, length, captions."""
    kept = []
    for number, (name, frames, text) in enumerate(files):
        if not 40 <= frames < 200:
            continue
        whole, parts = [], 0
        try:
            for line in text.splitlines():
                fields = line.strip().split("#")
                caption, tokens = fields[0], fields[1].split(" ")
                start, end = [0.0 if math.isnan(float(x)) else float(x) for x in fields[2:4]]
                if start == end == 0.0:
                    whole.append((caption, tokens))
                    continue
                cut = range(frames)[int(start * 20) : int(end * 20)]
                if 40 <= len(cut) < 200:
                    kept.append((f"{'ABCDEFGH'[parts]}_{name}", number, cut[0], len(cut), [(caption, tokens)]))
                    parts += 1
        except (ValueError, IndexError):
            continue
        if whole:
            kept.append((name, number, 0, frames, whole))
    return sorted(kept, key=lambda clip: clip[3])


def draw(clips, draws):
    """A pass of the public loader: the shuffled order, and what it chooses of each motion."""
    order = draws.sample(range(len(clips)), len(clips))
    samples = []
    for _, _, _, frames, captions in clips:
        caption = draws.randrange(len(captions))
        length = (frames // UNIT - (draws.choice(["single", "single", "double"]) == "double")) * UNIT
        samples.append((caption, draws.randint(0, frames - length), length))
    return order, samples


class Judge:
    def __init__(self, vectors, mean, std):
        self.movement, self.motion, self.text = Movement(), Recurrent(LATENT, MOTION), TextEncoder()
        for network in (self.movement, self.motion, self.text):
            network.eval()
            for parameter in network.parameters():
                parameter.data = parameter.data + 0.3 * torch.randn_like(parameter)
        self.vectors, self.mean, self.std = vectors, mean, std

    @torch.no_grad()
    def motions(self, motions):
        padded = torch.zeros(len(motions), LONGEST, POSE)
        for row, x in zip(padded, motions):
            row[: len(x)] = torch.from_numpy((x - self.mean) / self.std)
        lengths = [len(x) // UNIT for x in motions]
        return self.motion.read(self.movement(padded[..., :-4]), lengths).numpy().astype(np.float64)

    @torch.no_grad()
    def texts(self, texts):
        words = torch.zeros(len(texts), 22, WORD)
        parts = torch.zeros(len(texts), 22, len(PARTS))
        lengths = []
        for row, tokens in enumerate(texts):
            tokens = ["sos/OTHER"] + tokens[:20] + ["eos/OTHER"]
            lengths.append(len(tokens))
            for place, token in enumerate(tokens + ["unk/OTHER"] * (22 - len(tokens))):
                word, part = token.split("/")
                if word not in self.vectors:
                    word, part = "unk", "OTHER"
                part = SPECIAL.get(word, part)
                words[row, place] = torch.from_numpy(self.vectors[word])
                parts[row, place, PARTS.index(part if part in PARTS else "OTHER")] = 1
        return self.text.read(words + self.text.pos_emb(parts), lengths).numpy().astype(np.float64)


def frechet(a, b):
    (m, s), (n, t) = [(x.mean(axis=0), np.cov(x, rowvar=False)) for x in (a, b)]
    return float((m - n) @ (m - n) + np.trace(s) + np.trace(t) - 2 * np.trace(linalg.sqrtm(s @ t).real))


def figures(texts, motions, reference, pairs):
    hits, total = np.zeros(3), 0.0
    for start in range(0, len(motions), BATCH):
        distances = np.linalg.norm(texts[start : start + BATCH, None] - motions[None, start : start + BATCH], axis=2)
        ranks = np.argsort(distances, axis=1) == np.arange(BATCH)[:, None]
        hits += [ranks[:, : k + 1].any(axis=1).sum() for k in range(3)]
        total += np.trace(distances)
    diversity = np.mean([np.linalg.norm(motions[a] - motions[b]) for a, b in pairs])
    return [*(hits / len(motions)), total / len(motions), frechet(reference, motions), float(diversity)]


def main():
    draws = random.Random(5)
    torch.manual_seed(20220620)
    files = recordings(draws)
    clips = counted(files)
    whole = [features(number, frames) for number, (_, frames, _) in enumerate(files)]
    cut = lambda clip, sample: whole[clip[1]][clip[2] + sample[1] :][: sample[2]]

    rows = np.concatenate([whole[clip[1]][clip[2] : clip[2] + clip[3]] for clip in clips]).astype(np.float64)
    mean, deviations, std, at = rows.mean(axis=0), rows.std(axis=0), np.zeros(POSE), 0
    for group, width in enumerate(GROUPS):
        std[at : at + width] = deviations[at : at + width].mean() / (5 if group in BIASED else 1)
        at += width
    mean, std = mean.astype(np.float32), std.astype(np.float32)

    words = "sos eos unk a man someone the figure walk wave hand turn left sit on chair slowly and then jump".split()
    generator = np.random.default_rng(3)
    table = generator.normal(size=(len(words) + 2, WORD))
    index = {word: row + 1 for row, word in enumerate(words)}
    judge = Judge({word: table[row].astype(np.float32) for word, row in index.items()}, mean, std)

    # Texts lie where motions do, and are as far from each other, so that some find their motion and others do not.
    some = clips[:BATCH]
    made = judge.motions([cut(clip, (0, 0, clip[3] // UNIT * UNIT)) for clip in some])
    read = lambda: judge.texts([clip[4][0][1] for clip in some])
    last = judge.text.output_net[3]
    last.weight.data *= float(made.std(axis=0).mean() / read().std(axis=0).mean())
    last.bias.data += torch.from_numpy(made.mean(axis=0) - read().mean(axis=0)).float()

    for place in ["text_mot_match/model", "Comp_v6_KLD01/meta", "glove"]:
        (HERE / place).mkdir(parents=True, exist_ok=True)
    np.save(HERE / "Comp_v6_KLD01/meta/mean.npy", mean)
    np.save(HERE / "Comp_v6_KLD01/meta/std.npy", std)
    np.save(HERE / "glove/our_vab_data.npy", table)
    (HERE / "glove/our_vab_words.pkl").write_bytes(pickle.dumps(words, protocol=3))
    (HERE / "glove/our_vab_idx.pkl").write_bytes(pickle.dumps(index, protocol=3))
    networks = dict(text_encoder=judge.text, motion_encoder=judge.motion, movement_encoder=judge.movement)
    torch.save(
        {**{name: network.state_dict() for name, network in networks.items()}, "epoch": 1},
        HERE / "text_mot_match/model/finest.tar",
    )

    values = {row: [] for row in ["real", "generated"]}
    recorded, multimodality = [], []
    for replication in range(REPLICATIONS):
        (order, samples), (other_order, other) = draw(clips, draws), draw(clips, draws)
        kept = len(clips) // BATCH * BATCH
        pairs = [draws.sample(range(kept), DIVERSITY_PAIRS) for _ in range(2)]
        pairs = list(zip(*pairs))
        texts = judge.texts([clips[i][4][samples[i][0]][1] for i in order[:kept]])
        reference = judge.motions([cut(clips[i], other[i]) for i in other_order[:kept]])
        real = judge.motions([cut(clips[i], samples[i]) for i in order[:kept]])
        seed = lambda clip, repeat: 5000 + 1000 * replication + 10 * clip + repeat
        made = judge.motions([features(seed(i, 0), samples[i][2]) for i in order[:kept]])
        for row, motions in [("real", real), ("generated", made)]:
            values[row].append(figures(texts, motions, reference, pairs))

        many = order[:MANY_TEXTS]
        sets = [judge.motions([features(seed(i, k), samples[i][2]) for k in range(MANY_MOTIONS)]) for i in many]
        many_pairs = [draws.sample(range(MANY_MOTIONS), MANY_PAIRS) for _ in range(2)]
        many_pairs = list(zip(*many_pairs))
        distances = [np.linalg.norm(x[a] - x[b]) for x in sets for a, b in many_pairs]
        multimodality.append(float(np.mean(distances)))
        recorded.append(
            dict(order=order, samples=samples, reference_order=other_order, reference=other, pairs=pairs, many_pairs=many_pairs)
        )

    summary = {}
    for row, found in values.items():
        summary[row] = dict(mean=np.mean(found, axis=0).tolist(), each=found)
        summary[row]["interval"] = (1.96 * np.std(found, axis=0) / np.sqrt(REPLICATIONS)).tolist()
    case = dict(
        recordings=files,
        clips=[[name, frames, [caption for caption, _ in captions]] for name, _, _, frames, captions in clips],
        replications=recorded,
        rows=summary,
        multimodality=multimodality,
        many=[MANY_TEXTS, MANY_MOTIONS],
    )
    (HERE / "case.json").write_text(json.dumps(case) + "\n")
    print(len(clips), "motions;", summary["generated"]["mean"], multimodality)


main()

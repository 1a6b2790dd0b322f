"""Writes the golden cases of MDM: for each of three networks a model file, its `args.json`, and `case.safetensors`.

    pip install torch numpy safetensors
    python make.py                       the golden cases, beside this file
    python make.py --full-size FOLDER    files of the sizes of the public checkpoints, with random weights

The networks are written down here from the papers and with the keys of the public code, in plain PyTorch and at small
sizes. The model files are written in the forms in which public checkpoints come: a plain state dict, and a dict of
the weights and their average.
"""

import json
import math
import sys
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from torch import nn

HERE = Path(__file__).parent
FEATURES = 263


class Positions(nn.Module):
    def __init__(self, width, rows):
        super().__init__()
        table = torch.zeros(rows, width)
        position = torch.arange(0, rows, dtype=torch.float).unsqueeze(1)
        frequency = torch.exp(torch.arange(0, width, 2).float() * (-np.log(10000.0) / width))
        table[:, 0::2] = torch.sin(position * frequency)
        table[:, 1::2] = torch.cos(position * frequency)
        self.register_buffer("pe", table.unsqueeze(0).transpose(0, 1))


class Time(nn.Module):
    def __init__(self, width, positions):
        super().__init__()
        self.sequence_pos_encoder = positions
        self.time_embed = nn.Sequential(nn.Linear(width, width), nn.SiLU(), nn.Linear(width, width))

    def forward(self, timesteps):
        return self.time_embed(self.sequence_pos_encoder.pe[timesteps]).permute(1, 0, 2)


class Named(nn.Module):
    """A linear layer under a name."""

    def __init__(self, name, *sizes):
        super().__init__()
        self.add_module(name, nn.Linear(*sizes))

    def forward(self, x):
        return next(self.children())(x)


class Mdm(nn.Module):
    def __init__(self, arch, latent, layers, ff, text_width, heads=4, positions=5000, prefix=0):
        super().__init__()
        self.arch, self.prefix = arch, prefix
        self.input_process = Named("poseEmbedding", FEATURES, latent)
        self.sequence_pos_encoder = Positions(latent, positions)
        if arch == "trans_enc":
            layer = nn.TransformerEncoderLayer(latent, heads, ff, 0.1, "gelu")
            self.seqTransEncoder = nn.TransformerEncoder(layer, layers, enable_nested_tensor=False)
        else:
            layer = nn.TransformerDecoderLayer(latent, heads, ff, 0.1, "gelu")
            self.seqTransDecoder = nn.TransformerDecoder(layer, layers)
        self.embed_timestep = Time(latent, self.sequence_pos_encoder)
        self.embed_text = nn.Linear(text_width, latent)
        self.output_process = Named("poseFinal", latent, FEATURES)

    def forward(self, x, timesteps, embedding, text_mask=None, frame_mask=None, prefix=None):
        """x: [batch, frames, features]; embedding: [tokens, batch, latent], without the timestep."""
        memory = embedding + self.embed_timestep(timesteps)
        if prefix is not None:
            x = torch.cat([prefix, x], dim=1)
        x = self.input_process(x.permute(1, 0, 2))
        positions = self.sequence_pos_encoder.pe
        if self.arch == "trans_enc":
            sequence = torch.cat([memory, x])
            mask = None if frame_mask is None else torch.cat([torch.zeros_like(frame_mask[:, :1]), frame_mask], dim=1)
            sequence = sequence + positions[: len(sequence)]
            out = self.seqTransEncoder(sequence, src_key_padding_mask=mask)[1:]
        else:
            sequence = x + positions[: len(x)]
            if prefix is not None and frame_mask is not None:
                seen = torch.zeros(len(frame_mask), prefix.shape[1], dtype=torch.bool)
                frame_mask = torch.cat([seen, frame_mask], dim=1)
            out = self.seqTransDecoder(
                sequence, memory, memory_key_padding_mask=text_mask, tgt_key_padding_mask=frame_mask
            )
        if prefix is not None:
            out = out[prefix.shape[1] :]
        return self.output_process(out).permute(1, 0, 2)


class ClipBlock(nn.Module):
    def __init__(self, width, heads):
        super().__init__()
        self.attn = nn.MultiheadAttention(width, heads)
        self.ln_1, self.ln_2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.mlp = nn.Sequential()
        self.mlp.add_module("c_fc", nn.Linear(width, 4 * width))
        self.mlp.add_module("gelu", nn.Identity())
        self.mlp.add_module("c_proj", nn.Linear(4 * width, width))

    def forward(self, x, mask):
        y = self.ln_1(x)
        x = x + self.attn(y, y, y, need_weights=False, attn_mask=mask)[0]
        hidden = self.mlp.c_fc(self.ln_2(x))
        return x + self.mlp.c_proj(hidden * torch.sigmoid(1.702 * hidden))


class Clip(nn.Module):
    def __init__(self, vocabulary, width, context, layers, output):
        super().__init__()
        heads = max(1, -(-width // 64))
        self.token_embedding = nn.Embedding(vocabulary, width)
        self.positional_embedding = nn.Parameter(torch.randn(context, width) * 0.1)
        self.transformer = nn.Module()
        self.transformer.resblocks = nn.ModuleList(ClipBlock(width, heads) for _ in range(layers))
        self.ln_final = nn.LayerNorm(width)
        self.text_projection = nn.Parameter(torch.randn(width, output) * width**-0.5)

    def forward(self, ids):
        context = len(self.positional_embedding)
        ids = torch.cat([ids, torch.zeros(len(ids), context - ids.shape[1], dtype=ids.dtype)], dim=1)
        mask = torch.full((context, context), float("-inf")).triu_(1)
        x = (self.token_embedding(ids) + self.positional_embedding).permute(1, 0, 2)
        for block in self.transformer.resblocks:
            x = block(x, mask)
        x = self.ln_final(x.permute(1, 0, 2))
        return x[torch.arange(len(x)), ids.argmax(dim=-1)] @ self.text_projection

    def hugging_face(self):
        """The same weights under the names of `transformers`."""
        state = self.state_dict()
        renamed = {
            "text_model.embeddings.token_embedding.weight": state["token_embedding.weight"],
            "text_model.embeddings.position_embedding.weight": state["positional_embedding"],
            "text_projection.weight": state["text_projection"].T,
        }
        for end in ("weight", "bias"):
            renamed[f"text_model.final_layer_norm.{end}"] = state[f"ln_final.{end}"]
            for i in range(len(self.transformer.resblocks)):
                old, new = f"transformer.resblocks.{i}.", f"text_model.encoder.layers.{i}."
                parts = state[f"{old}attn.in_proj_{end}"].chunk(3)
                for name, part in zip("qkv", parts):
                    renamed[f"{new}self_attn.{name}_proj.{end}"] = part
                renamed[f"{new}self_attn.out_proj.{end}"] = state[f"{old}attn.out_proj.{end}"]
                renamed[f"{new}layer_norm1.{end}"] = state[f"{old}ln_1.{end}"]
                renamed[f"{new}layer_norm2.{end}"] = state[f"{old}ln_2.{end}"]
                renamed[f"{new}mlp.fc1.{end}"] = state[f"{old}mlp.c_fc.{end}"]
                renamed[f"{new}mlp.fc2.{end}"] = state[f"{old}mlp.c_proj.{end}"]
        # What is in such a file beside the text tower.
        renamed["logit_scale"] = torch.tensor(4.6)
        renamed["visual_projection.weight"] = torch.zeros(2, 3)
        return renamed


class BertLayer(nn.Module):
    def __init__(self, width, heads, ff):
        super().__init__()
        self.heads = heads
        self.attention = nn.Module()
        for name in ("q_lin", "k_lin", "v_lin", "out_lin"):
            self.attention.add_module(name, nn.Linear(width, width))
        self.sa_layer_norm = nn.LayerNorm(width, eps=1e-12)
        self.ffn = nn.Module()
        self.ffn.lin1, self.ffn.lin2 = nn.Linear(width, ff), nn.Linear(ff, width)
        self.output_layer_norm = nn.LayerNorm(width, eps=1e-12)

    def forward(self, x, mask):
        split = lambda y: y.view(*y.shape[:2], self.heads, -1).transpose(1, 2)
        q, k, v = (split(layer(x)) for layer in (self.attention.q_lin, self.attention.k_lin, self.attention.v_lin))
        scores = (q / math.sqrt(q.shape[-1])) @ k.transpose(2, 3)
        scores = scores.masked_fill(~mask[:, None, None, :], float("-inf"))
        attended = (scores.softmax(-1) @ v).transpose(1, 2).reshape(x.shape)
        x = self.sa_layer_norm(x + self.attention.out_lin(attended))
        return self.output_layer_norm(x + self.ffn.lin2(nn.functional.gelu(self.ffn.lin1(x))))


class DistilBert(nn.Module):
    def __init__(self, vocabulary, width, positions, layers, ff):
        super().__init__()
        heads = max(1, -(-width // 64))
        self.embeddings = nn.Module()
        self.embeddings.word_embeddings = nn.Embedding(vocabulary, width)
        self.embeddings.position_embeddings = nn.Embedding(positions, width)
        self.embeddings.LayerNorm = nn.LayerNorm(width, eps=1e-12)
        self.transformer = nn.Module()
        self.transformer.layer = nn.ModuleList(BertLayer(width, heads, ff) for _ in range(layers))

    def forward(self, ids, mask):
        x = self.embeddings.word_embeddings(ids) + self.embeddings.position_embeddings.weight[: ids.shape[1]]
        x = self.embeddings.LayerNorm(x)
        for layer in self.transformer.layer:
            x = layer(x, mask)
        return x


def roughen(network):
    """Fresh norms are plain and fresh biases are zero: nothing would be tested of them."""
    for parameter in network.parameters():
        parameter.data = parameter.data + 0.1 * torch.randn_like(parameter)
    return network.eval()


def cosine_alphas(steps):
    f = lambda t: math.cos((t + 0.008) / 1.008 * math.pi / 2) ** 2
    betas = [min(1 - f((i + 1) / steps) / f(i / steps), 0.999) for i in range(steps)]
    return np.cumprod(1.0 - np.array(betas, dtype=np.float64))


def sample(evaluate, alphas, noise, step_noise):
    """Runs all steps of the network's own sampler (Ho et al. 2020) where there is `step_noise`, else of DDIM."""
    x = noise
    for i, t in enumerate(reversed(range(len(alphas)))):
        clean = evaluate(x, t)
        alpha, before = float(alphas[t]), float(alphas[t - 1]) if t > 0 else 1.0
        beta = 1 - alpha / before
        if step_noise is not None:
            mean = (beta * math.sqrt(before) * clean + (1 - before) * math.sqrt(1 - beta) * x) / (1 - alpha)
            variance = beta * (1 - before) / (1 - alpha)
            x = mean + (math.sqrt(variance) * step_noise[i] if t > 0 else 0.0)
        else:
            eps = (x / math.sqrt(alpha) - clean) / math.sqrt(1 / alpha - 1)
            x = clean * math.sqrt(before) + math.sqrt(1 - before) * eps
    return x


def write_case(name, args, network, text, ids, lengths, frames, form, prefix=None, scale=2.5):
    folder = HERE / name
    folder.mkdir(exist_ok=True)
    (folder / "args.json").write_text(json.dumps(args, indent=2) + "\n")
    state = {key: value.clone() for key, value in network.state_dict().items()}
    if form == "plain":
        torch.save(state, folder / "model000000010.pt")
    else:
        other = {key: value + 1.0 for key, value in state.items()}
        torch.save({"model": other, "model_avg": state}, folder / "model000000010.pt")

    batch, longest = len(frames), max(frames)
    mask = torch.arange(ids.shape[1])[None] < torch.tensor(lengths)[:, None]
    if isinstance(text, Clip):
        features, text_mask = text(ids)[None], None
    else:
        features, text_mask = text(ids, mask).permute(1, 0, 2), ~mask
    embedding = network.embed_text(features).detach()
    unconditional = network.embed_text(torch.zeros_like(features)).detach()
    frame_mask = torch.arange(longest)[None] >= torch.tensor(frames)[:, None]
    x = torch.randn(batch, longest, FEATURES)
    timestep = 2

    def evaluate(x, t, e):
        timesteps = torch.full((batch,), t, dtype=torch.long)
        return network(x, timesteps, e, text_mask, frame_mask, prefix)

    leaf = embedding.clone().requires_grad_(True)
    conditional = evaluate(x, timestep, leaf)
    without = evaluate(x, timestep, unconditional)
    keep = (~frame_mask)[:, :, None].float()
    pull = x * keep
    # The gradient of guidance goes through the conditioned branch alone, times the scale.
    guided = without.detach() + scale * (conditional - without.detach())
    (guided * pull).sum().backward()

    steps = args["diffusion_steps"]
    alphas = cosine_alphas(steps)
    noise = x
    step_noise = torch.randn(steps, batch, longest, FEATURES)
    if steps > 4:
        # Long passes need much noise, of which a file would be large: a short pass has its own, a long one has none.
        step_noise = None

    def guided_evaluation(x, t):
        c, u = evaluate(x, t, embedding), evaluate(x, t, unconditional)
        return u + scale * (c - u)

    with torch.no_grad():
        passes = {"pass": sample(guided_evaluation, alphas, noise, step_noise)}
        if step_noise is not None:
            passes["pass.ddim"] = sample(guided_evaluation, alphas, noise, None)
            passes["step_noise"] = step_noise
    rows = lambda e: e.permute(1, 0, 2).reshape(batch, -1)
    tensors = dict(
        ids=ids.int(),
        lengths=torch.tensor(lengths, dtype=torch.int32),
        frames=torch.tensor(frames, dtype=torch.int32),
        embedding=rows(embedding),
        x=x,
        timestep=torch.tensor([timestep], dtype=torch.int32),
        conditional=conditional * keep,
        guided=guided * keep,
        gradient=rows(leaf.grad),
        scale=torch.tensor([scale]),
        **{key: value * keep if key != "step_noise" else value for key, value in passes.items()},
    )
    if prefix is not None:
        tensors["prefix"] = prefix
    save_file({key: value.detach().contiguous() for key, value in tensors.items()}, folder / "case.safetensors")


def golden():
    torch.manual_seed(20220929)
    latent, layers, ff = 16, 2, 24
    clip = roughen(Clip(40, 12, 14, 2, 10))
    save_file({key: value.contiguous() for key, value in clip.hugging_face().items()}, HERE / "clip.safetensors")
    torch.save(clip.state_dict(), HERE / "clip.pt")
    bert = roughen(DistilBert(30, 14, 9, 2, 20))
    state = {f"distilbert.{key}": value for key, value in bert.state_dict().items()}
    state["vocab_projector.bias"] = torch.zeros(30)
    save_file(state, HERE / "distilbert.safetensors")

    ids = torch.tensor([[38, 4, 7, 39, 0, 0], [38, 5, 6, 11, 2, 39]])
    network = roughen(Mdm("trans_enc", latent, layers, ff, 10, positions=64))
    args = dict(arch="trans_enc", layers=layers, latent_dim=latent, diffusion_steps=50, lambda_vel=0.0, guidance_param=2.5)
    write_case("trans_enc", args, network, clip, ids, [4, 6], [6, 4], "plain")

    ids = torch.tensor([[28, 4, 7, 29, 0, 0], [28, 5, 6, 11, 2, 29]])
    args = dict(
        arch="trans_dec",
        text_encoder_type="bert",
        layers=layers,
        latent_dim=latent,
        diffusion_steps=3,
        mask_frames=True,
        use_ema=True,
    )
    network = roughen(Mdm("trans_dec", latent, layers, ff, 14, positions=64))
    write_case("trans_dec", args, network, bert, ids, [4, 6], [6, 4], "averaged")

    args = dict(args, context_len=4, pred_len=6, diffusion_steps=4)
    network = roughen(Mdm("trans_dec", latent, layers, ff, 14, positions=64))
    prefix = torch.randn(2, 4, FEATURES)
    write_case("dip", args, network, bert, ids, [4, 6], [6, 6], "averaged", prefix, scale=7.5)


def full_size(folder):
    """Files of the sizes of the public checkpoints, which have random weights."""
    folder = Path(folder)
    torch.manual_seed(1)
    clip = Clip(49408, 512, 77, 12, 512)
    (folder / "trans_enc").mkdir(parents=True, exist_ok=True)
    (folder / "trans_dec").mkdir(exist_ok=True)
    save_file({k: v.contiguous() for k, v in clip.hugging_face().items()}, folder / "trans_enc" / "clip.safetensors")
    network = Mdm("trans_enc", 512, 8, 1024, 512)
    torch.save(network.state_dict(), folder / "trans_enc" / "model000750000.pt")
    (folder / "trans_enc" / "args.json").write_text(json.dumps(dict(arch="trans_enc", diffusion_steps=50)))
    network = Mdm("trans_dec", 512, 8, 1024, 768)
    state = network.state_dict()
    torch.save({"model": state, "model_avg": {k: v.clone() for k, v in state.items()}}, folder / "trans_dec" / "model000600000.pt")
    args = dict(arch="trans_dec", text_encoder_type="bert", diffusion_steps=50, mask_frames=True, use_ema=True)
    (folder / "trans_dec" / "args.json").write_text(json.dumps(args))
    bert = DistilBert(30522, 768, 512, 6, 3072)
    state = {f"distilbert.{key}": value for key, value in bert.state_dict().items()}
    save_file(state, folder / "trans_dec" / "distilbert.safetensors")


if sys.argv[1:2] == ["--full-size"]:
    full_size(sys.argv[2])
else:
    golden()

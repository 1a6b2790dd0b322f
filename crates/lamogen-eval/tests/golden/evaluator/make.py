"""Writes the golden case of the text-motion matching network: `finest.tar`, `config.json`, `case.safetensors`.

    pip install torch numpy safetensors
    python make.py

The networks are written down here from the description in Guo et al. 2022 and with the keys of its public code, in
plain PyTorch and at small sizes. `finest.tar` holds what the public trainer saves, its optimisers' states included.
"""

import json
from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import nn
from torch.nn.utils.rnn import pack_padded_sequence

HERE = Path(__file__).parent
SIZES = dict(
    dim_pose=13,
    max_motion_length=28,
    dim_movement_enc_hidden=10,
    dim_movement_latent=8,
    dim_motion_hidden=12,
    dim_text_hidden=11,
    dim_coemb_hidden=9,
)
WORD, PARTS = 7, 15
# 28 is the longest there may be (nothing follows it), 27 is no multiple of four, 4 is one movement.
FRAMES = [16, 28, 27, 4, 24]
WORDS = [5, 8, 1, 8, 3]


class Movement(nn.Module):
    def __init__(self):
        super().__init__()
        hidden, latent = SIZES["dim_movement_enc_hidden"], SIZES["dim_movement_latent"]
        self.main = nn.Sequential(
            nn.Conv1d(SIZES["dim_pose"] - 4, hidden, 4, stride=2, padding=1),
            nn.Dropout(0.2),
            nn.LeakyReLU(0.2),
            nn.Conv1d(hidden, latent, 4, stride=2, padding=1),
            nn.Dropout(0.2),
            nn.LeakyReLU(0.2),
        )
        self.out_net = nn.Linear(latent, latent)

    def forward(self, x):
        return self.out_net(self.main(x.transpose(1, 2)).transpose(1, 2))


class Recurrent(nn.Module):
    """What the encoders of texts and motions have in common."""

    def __init__(self, width, hidden):
        super().__init__()
        self.input_emb = nn.Linear(width, hidden)
        self.gru = nn.GRU(hidden, hidden, batch_first=True, bidirectional=True)
        out = SIZES["dim_coemb_hidden"]
        self.output_net = nn.Sequential(
            nn.Linear(2 * hidden, hidden), nn.LayerNorm(hidden), nn.LeakyReLU(0.2), nn.Linear(hidden, out)
        )
        self.hidden = nn.Parameter(torch.randn(2, 1, hidden))

    def read(self, x, lengths):
        start = self.hidden.repeat(1, len(lengths), 1)
        packed = pack_padded_sequence(self.input_emb(x), lengths, batch_first=True, enforce_sorted=False)
        _, last = self.gru(packed, start)
        return self.output_net(torch.cat([last[0], last[1]], dim=-1))


class Motion(Recurrent):
    def __init__(self):
        super().__init__(SIZES["dim_movement_latent"], SIZES["dim_motion_hidden"])


class Text(Recurrent):
    def __init__(self):
        super().__init__(WORD, SIZES["dim_text_hidden"])
        self.pos_emb = nn.Linear(PARTS, WORD)


def contrastive(a, b, apart, margin=10.0):
    distance = nn.functional.pairwise_distance(a, b)
    if apart:
        return torch.clamp(margin - distance, min=0).square().mean()
    return distance.square().mean()


def main():
    torch.manual_seed(20220619)
    movement, motion, text = Movement(), Motion(), Text()
    for network in (movement, motion, text):
        for parameter in network.parameters():
            # Fresh weights are small and layer norms are plain: nothing would be tested of them.
            parameter.data = parameter.data + 0.3 * torch.randn_like(parameter)

    features = torch.randn(len(FRAMES), max(FRAMES), SIZES["dim_pose"] - 4)
    vectors = torch.randn(len(WORDS), max(WORDS), WORD)
    parts = nn.functional.one_hot(torch.randint(0, PARTS, (len(WORDS), max(WORDS))), PARTS).float()

    # The public loader keeps whole movements, and fills up with zeros to the longest motion there may be.
    padded = torch.zeros(len(FRAMES), SIZES["max_motion_length"], features.shape[2])
    movements = [frames // 4 for frames in FRAMES]
    for row, count in enumerate(movements):
        padded[row, : 4 * count] = features[row, : 4 * count]

    optimisers = {name: torch.optim.Adam(net.parameters()) for name, net in [("text", text), ("motion", motion)]}
    for network in (movement, motion, text):
        network.eval()
    motions = motion.read(movement(padded), movements)
    texts = text.read(vectors + text.pos_emb(parts), WORDS)
    shift = 2
    loss = contrastive(texts, motions, False) + contrastive(texts, motions.roll(-shift, 0), True)
    loss.backward()
    gradients = {
        "gradient.text": text.gru.weight_hh_l0_reverse.grad,
        "gradient.motion": movement.main[0].weight.grad,
        "gradient.start": motion.hidden.grad,
    }
    file = dict(
        text_encoder=text.state_dict(),
        motion_encoder=motion.state_dict(),
        movement_encoder=movement.state_dict(),
    )
    file = {name: {key: value.clone() for key, value in state.items()} for name, state in file.items()}
    for optimiser in optimisers.values():
        optimiser.step()
    file.update(
        opt_text_encoder=optimisers["text"].state_dict(),
        opt_motion_encoder=optimisers["motion"].state_dict(),
        epoch=3,
        iter=42,
    )
    torch.save(file, HERE / "finest.tar")
    config = {**SIZES, "text": {"words": {"dim_word": WORD, "dim_pos_ohot": PARTS}}}
    (HERE / "config.json").write_text(json.dumps(config, indent=2) + "\n")
    tensors = dict(
        features=features,
        frames=torch.tensor(FRAMES, dtype=torch.int32),
        vectors=vectors,
        parts_of_speech=parts,
        words=torch.tensor(WORDS, dtype=torch.int32),
        motion_embeddings=motions,
        text_embeddings=texts,
        shift=torch.tensor([shift], dtype=torch.int32),
        loss=loss.reshape(1),
        **gradients,
    )
    save_file({key: value.detach().contiguous() for key, value in tensors.items()}, HERE / "case.safetensors")


main()

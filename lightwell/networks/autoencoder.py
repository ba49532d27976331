"""A tied-weight auto-encoder whose code selects experts: the gate of the 2013 report on mixtures of experts.

    h₀ = x,  h_k = tanh(h_{k−1} W_k + b_k),  code h = σ(h_{n−1} W_n + b_n)
    r_n = h,  r_{k−1} = tanh(r_k W_kᵀ + c_k)
    loss = mean (x − r₀)² + decay Σ_k ‖W_k‖² + η Var_j( mean_b h_j )

x [B, in] inputs, h [B, M] one number in (0, 1) per expert, W_k shared by encoder and decoder; the expert of a sample is
argmax_j h_j. The last term makes the experts' mean codes similar. In NumPy: batches are too small for a device.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class GateTraining:
    """Settings of the gate's training: plain gradient descent with the rate μ_e = μ0 τ / (τ + e) in epoch e."""

    epochs: int = 10
    rate: float = 1.0
    tau: float = 30.0
    batch: int = 16
    most_updates: int = 20_000
    """Rows per epoch are limited so that there are at most this many updates (a few seconds); the report had about
    300,000. The code is balanced after a few thousand."""


@dataclass(frozen=True)
class TiedAutoencoder:
    """A tied-weight auto-encoder; its parameters are a dict of float64 arrays ``w0 [in, out], b0 [out], c0 [in], w1
    …``.
    """

    sizes: tuple[int, ...] = (12, 20, 20, 10)
    """Widths from the input to the code; the report's by default."""
    decay: float = 1e-5
    balance: float = 6.0
    """η: weight of the variance of the mean codes."""

    @property
    def layers(self) -> int:
        """Number of layers of the encoder."""
        return len(self.sizes) - 1

    def initial(self, seed: int) -> dict[str, np.ndarray]:
        """Draw initial weights U(±√(6/(in+out))); biases are 0.

        Args:
            seed: Seed of the weights.

        Returns:
            Parameters, float64.
        """
        rng, parameters = np.random.default_rng(seed), {}
        for k, (a, b) in enumerate(zip(self.sizes, self.sizes[1:])):
            bound = np.sqrt(6.0 / (a + b))
            parameters[f"w{k}"] = rng.uniform(-bound, bound, (a, b))
            parameters[f"b{k}"], parameters[f"c{k}"] = np.zeros(b), np.zeros(a)
        return parameters

    def _encode(self, parameters: dict[str, np.ndarray], x: np.ndarray) -> list[np.ndarray]:
        values = [x]
        for k in range(self.layers):
            z = values[-1] @ parameters[f"w{k}"] + parameters[f"b{k}"]
            values.append(np.tanh(z) if k + 1 < self.layers else 1 / (1 + np.exp(-z)))
        return values

    def encode(self, parameters: dict[str, np.ndarray], x: np.ndarray) -> np.ndarray:
        """Compute codes.

        Args:
            parameters: Weights ``w0 [in, out], b0 [out], c0 [in], w1 …``.
            x: [B, in] inputs.

        Returns:
            [B, M] codes in (0, 1).
        """
        return self._encode(parameters, x)[-1]

    def loss(self, parameters: dict[str, np.ndarray], x: np.ndarray) -> tuple[float, dict[str, np.ndarray]]:
        """Compute the loss of a batch and its gradient by backpropagation through decoder and encoder.

        Args:
            parameters: Weights ``w0 [in, out], b0 [out], c0 [in], w1 …``.
            x: [B, in] inputs.

        Returns:
            The loss and its gradient, shaped like the parameters.
        """
        up = self._encode(parameters, x)
        # Decode: down[k] is r_k, from the code to the reconstruction.
        down = {self.layers: up[-1]}
        for k in reversed(range(self.layers)):
            down[k] = np.tanh(down[k + 1] @ parameters[f"w{k}"].T + parameters[f"c{k}"])
        mean = up[-1].mean(axis=0)
        weights = sum(float((parameters[f"w{k}"] ** 2).sum()) for k in range(self.layers))
        value = float(((x - down[0]) ** 2).mean()) + self.decay * weights + self.balance * float(mean.var())
        gradient = {f"w{k}": 2 * self.decay * parameters[f"w{k}"] for k in range(self.layers)}
        # Backpropagate through the decoder, reconstruction first.
        by_value = 2 * (down[0] - x) / x.size
        for k in range(self.layers):
            by_sum = by_value * (1 - down[k] ** 2)
            gradient[f"w{k}"] += by_sum.T @ down[k + 1]
            gradient[f"c{k}"] = by_sum.sum(axis=0)
            by_value = by_sum @ parameters[f"w{k}"]
        # Balance term: ∂Var/∂h_bj = 2 (mean_j − mean) / (M B).
        by_value = by_value + self.balance * 2 * (mean - mean.mean()) / (mean.size * len(x))
        # Backpropagate through the encoder.
        by_sum = by_value * up[-1] * (1 - up[-1])
        for k in reversed(range(self.layers)):
            gradient[f"w{k}"] += up[k].T @ by_sum
            gradient[f"b{k}"] = by_sum.sum(axis=0)
            if k:
                by_sum = (by_sum @ parameters[f"w{k}"].T) * (1 - up[k] ** 2)
        return value, gradient

    def train(self, x: np.ndarray, settings: GateTraining, seed: int) -> tuple[dict[str, np.ndarray], list[float]]:
        """Train on rows by gradient descent.

        Args:
            x: [N, in] inputs.
            settings: Rates, batches and epochs.
            seed: Seed of the weights and of the order of rows.

        Returns:
            The parameters, and the mean loss of each epoch.
        """
        rng, parameters = np.random.default_rng((seed, len(x))), self.initial(seed)
        most = max(settings.most_updates // settings.epochs, 1) * settings.batch
        rows = np.asarray(x[rng.permutation(len(x))[:most]], np.float64)
        history = []
        for epoch in range(settings.epochs):
            rate, losses = settings.rate * settings.tau / (settings.tau + epoch), []
            for begin in range(0, max(len(rows) - settings.batch + 1, 1), settings.batch):
                value, gradient = self.loss(parameters, rows[begin : begin + settings.batch])
                losses.append(value)
                parameters = {name: p - rate * gradient[name] for name, p in parameters.items()}
            history.append(float(np.mean(losses)))
        return parameters, history

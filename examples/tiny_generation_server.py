"""A server with the part of vLLM's HTTP API that TRL's AsyncGRPOTrainer uses, for a tiny model on a CPU, to test without vLLM.

It is for TRL 1.16, of whose modules it uses private parts.
`replace_gpu_parts` replaces three parts of TRL in this process: the check that vLLM is installed, the name of the GPU, and flash
attention 3.
"""

import contextlib
import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace
from typing import NamedTuple

import torch
from torch.nn.functional import scaled_dot_product_attention
from trl.experimental.async_grpo import async_grpo_trainer, async_rollout_worker, packing


class GenerationRequest(NamedTuple):
    """Prompt of a request, with the number of weight updates before its answer."""

    prompt: str
    updates: int


class GenerationServer:
    """Server in a thread of this process that samples from a model.

    Args:
        model: Model to sample from; the server changes its weights.
        tokenizer: Tokenizer of the model.
        max_model_len: Maximum number of tokens of a prompt and its answer.
    """

    def __init__(self, model, tokenizer, max_model_len=8192):
        self.model, self.tokenizer, self.max_model_len = model.eval(), tokenizer, max_model_len
        #: Requests in the order of their answers.
        self.requests = []
        #: Number of weight updates.
        self.updates = 0
        #: Held while the model answers, and while an update pauses the server.
        self.lock = threading.Lock()
        self._http = ThreadingHTTPServer(("127.0.0.1", 0), type("Handler", (_Handler,), {"server_state": self}))
        self._http.daemon_threads = True
        self._thread = threading.Thread(target=self._http.serve_forever, daemon=True)
        self._thread.start()
        self.url = f"http://127.0.0.1:{self._http.server_port}"

    def stop(self):
        """Stops the server and its thread."""
        self._http.shutdown()
        self._http.server_close()
        self._thread.join()

    def complete(self, body):
        """Answers a request of `/v1/completions`."""
        with self.lock, torch.no_grad():
            self.requests.append(GenerationRequest(self.tokenizer.decode(body["prompt"]), self.updates))
            tokens, logprobs = self._sample(body)
        return {"choices": [{"token_ids": tokens, "logprobs": {"token_logprobs": logprobs}}]}

    def _sample(self, body):
        generator = torch.Generator().manual_seed(body["seed"])
        ids, cache = torch.tensor([body["prompt"]]), None
        tokens, logprobs = [], []
        budget = min(body["max_tokens"], self.max_model_len - len(body["prompt"]))
        while len(tokens) < budget and self.tokenizer.eos_token_id not in tokens:
            output = self.model(input_ids=ids, past_key_values=cache, use_cache=True)
            scores = torch.log_softmax(output.logits[0, -1].float() / body["temperature"], dim=-1)
            token = torch.multinomial(scores.exp(), 1, generator=generator)
            tokens.append(int(token))
            logprobs.append(float(scores[token]))
            ids, cache = token[None], output.past_key_values
        return tokens, logprobs


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_state: GenerationServer

    def do_GET(self):
        models = {"data": [{"max_model_len": self.server_state.max_model_len}]}
        self._answer({"/health": {}, "/v1/models": models}.get(self.path))

    def do_POST(self):
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self._answer(self.server_state.complete(body) if self.path == "/v1/completions" else None)

    def _answer(self, value):
        text = json.dumps(value).encode()
        self.send_response(404 if value is None else 200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(text)))
        # TRL ends its worker without waiting for answers.
        with contextlib.suppress(ConnectionError):
            self.end_headers()
            self.wfile.write(text)

    def log_message(self, *_):
        """Writes no log of requests."""


class WeightCopy:
    """`weight_transfer` of AsyncGRPOTrainer that copies the weights to a server of this process."""

    def __init__(self, server):
        self._server = server

    def init_weight_transfer(self):
        """Does nothing, since there is no connection."""

    def pause(self):
        """Pauses the server's answers."""
        self._server.lock.acquire()

    def send_weights(self, iterator):
        """Copies all weights to the server's model."""
        targets = dict(self._server.model.named_parameters())
        with torch.no_grad():
            for name, weight in iterator:
                targets[name].copy_(weight)
        self._server.updates += 1

    def resume(self):
        """Resumes the server's answers."""
        self._server.lock.release()

    def destroy(self):
        """Does nothing, since there is no connection."""


def replace_gpu_parts():
    """Lets AsyncGRPOTrainer run in this process without vLLM and a GPU."""
    async_rollout_worker.is_vllm_available = lambda: True
    # The trainer logs no utilisation of a device whose speed is unknown.
    async_grpo_trainer.get_peak_flops_per_device = lambda *_: None
    packing._flash_attn = lambda: SimpleNamespace(flash_attn_varlen_func=attend_to_segments)


def attend_to_segments(query, key, value, query_ends, key_ends, max_query, max_key, *, softmax_scale, causal, window_size):
    """Computes flash attention 3 of segments of different lengths: each has its own rows of queries, keys and values.

    The last query of a segment attends to all its keys, the one before to all but the last, and so on.
    """
    assert causal and window_size == (-1, -1)
    outputs = []
    for segment in range(len(query_ends) - 1):
        rows, columns = slice(*query_ends[segment : segment + 2]), slice(*key_ends[segment : segment + 2])
        q, k, v = (x.transpose(0, 1)[None] for x in (query[rows], key[columns], value[columns]))
        lengths = (q.shape[2], k.shape[2])
        mask = torch.ones(lengths, dtype=torch.bool).tril(lengths[1] - lengths[0])
        attended = scaled_dot_product_attention(q, k, v, attn_mask=mask, scale=softmax_scale, enable_gqa=True)
        outputs.append(attended[0].transpose(0, 1))
    return torch.cat(outputs)

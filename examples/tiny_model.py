"""A random model of about 100 000 parameters with its tokenizer, to test trainers without a model hub.

Its text is meaningless. `teach` trains it to give some fixed answers, each of which is one token, so that it calls tools at
random.
"""

import random

import torch
from tokenizers import Tokenizer, decoders, models, pre_tokenizers, trainers
from transformers import PreTrainedTokenizerFast, Qwen2Config, Qwen2ForCausalLM
from trl.chat_template_utils import qwen2_5_chat_template

END_OF_TEXT, MESSAGE_START, MESSAGE_END = "<|endoftext|>", "<|im_start|>", "<|im_end|>"
ASSISTANT_HEAD = f"{MESSAGE_START}assistant\n"


def tool_call(name, **arguments):
    """Makes an assistant message that calls a tool."""
    return {"content": "", "tool_calls": [{"type": "function", "function": {"name": name, "arguments": arguments}}]}


def make_tiny_model(prompts, answers=(), tools=None, seed=1):
    """Makes a random model and its tokenizer.

    Args:
        prompts: Prompts that the tokenizer is trained on.
        answers: Assistant messages, each of which becomes one token.
        tools: Tools of the chat template.
        seed: Seed of the weights.
    """
    torch.manual_seed(seed)
    untrained = make_tokenizer([], [])
    user_messages = [{"role": "user", "content": prompt} for prompt in prompts]
    dialogs = [render(untrained, [user_messages[0], {"role": "assistant", **answer}]) for answer in answers]
    tokens = [text.rsplit(ASSISTANT_HEAD, 1)[1].rsplit(MESSAGE_END, 1)[0] for text in dialogs]
    texts = [render(untrained, user_messages, tools), *dialogs]
    tokenizer = make_tokenizer(texts, ["<tool_call>", "</tool_call>", *tokens])
    config = Qwen2Config(
        vocab_size=len(tokenizer),
        hidden_size=64,
        intermediate_size=128,
        num_hidden_layers=2,
        num_attention_heads=4,
        num_key_value_heads=2,
        max_position_embeddings=8192,
        tie_word_embeddings=True,
        bos_token_id=None,
        eos_token_id=tokenizer.eos_token_id,
        pad_token_id=tokenizer.pad_token_id,
    )
    return Qwen2ForCausalLM(config), tokenizer


def teach(model, tokenizer, prompts, answers, tools, steps=80, seed=1):
    """Trains a model to answer any of the prompts, and any tool result, by a random one of the answers.

    Returns:
        The last loss; its minimum is the entropy of the random choice.
    """
    rng = random.Random(seed)
    optimizer = torch.optim.AdamW(model.parameters(), lr=3e-3)
    schedule = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.02, steps)
    head = tokenizer.encode(ASSISTANT_HEAD, add_special_tokens=False)
    model.train()
    for _ in range(steps):
        messages = [{"role": "user", "content": rng.choice(prompts)}]
        for _ in range(12):
            result = {"role": "tool", "name": "telemetry", "content": rng.choice(prompts)[-150:]}
            messages += [{"role": "assistant", **rng.choice(answers)}, result]
        ids = tokenizer.apply_chat_template(messages, tools=tools, tokenize=True, return_dict=False)
        # Only the assistant's answer, one token, and the end of its message have labels.
        starts = [at + len(head) for at in range(len(ids)) if ids[at : at + len(head)] == head]
        labels = [token if at in starts or at - 1 in starts else -100 for at, token in enumerate(ids)]
        loss = model(input_ids=torch.tensor([ids]), labels=torch.tensor([labels])).loss
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        schedule.step()
    return float(loss.detach())


def make_tokenizer(texts, tokens):
    """Trains a byte-level tokenizer with the chat template of Qwen2.5, in which TRL finds tool calls."""
    bpe = Tokenizer(models.BPE())
    bpe.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    bpe.decoder = decoders.ByteLevel()
    alphabet = pre_tokenizers.ByteLevel.alphabet()
    special_tokens = [END_OF_TEXT, MESSAGE_START, MESSAGE_END]
    trainer = trainers.BpeTrainer(vocab_size=1024, special_tokens=special_tokens, initial_alphabet=alphabet)
    bpe.train_from_iterator(texts, trainer)
    tokenizer = PreTrainedTokenizerFast(tokenizer_object=bpe, eos_token=MESSAGE_END, pad_token=END_OF_TEXT)
    tokenizer.add_tokens(tokens)
    tokenizer.chat_template = qwen2_5_chat_template
    return tokenizer


def render(tokenizer, messages, tools=None):
    """Renders messages as text."""
    return tokenizer.apply_chat_template(messages, tools=tools, tokenize=False)

"""A model of a hundred thousand parameters and its tokenizer, made on the spot: where there is no model hub, and to see whether
all of a trainer runs before a real model is loaded. Random, it says nothing that means anything; `teach` has it know some answers
by heart, each of which is one word to it, so that it calls tools, at random.
"""
import random

import torch
from tokenizers import Tokenizer, decoders, models, pre_tokenizers, trainers
from transformers import PreTrainedTokenizerFast, Qwen2Config, Qwen2ForCausalLM
from trl.chat_template_utils import qwen2_5_chat_template

END, START, STOP = "<|endoftext|>", "<|im_start|>", "<|im_end|>"
HEAD = f"{START}assistant\n"


def call(name, **arguments):
    """An answer that calls a tool."""
    return {"content": "", "tool_calls": [{"type": "function", "function": {"name": name, "arguments": arguments}}]}


def rendered(tokenizer, said, tools=None):
    return tokenizer.apply_chat_template(said, tools=tools, tokenize=False)


def tokenizer_of(texts, words):
    """A byte-level tokenizer, trained on texts, whose chat template is Qwen2.5's: TRL reads tool calls out of that."""
    made = Tokenizer(models.BPE())
    made.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    made.decoder = decoders.ByteLevel()
    alphabet = pre_tokenizers.ByteLevel.alphabet()
    specials = [END, START, STOP]
    made.train_from_iterator(texts, trainers.BpeTrainer(vocab_size=1024, special_tokens=specials, initial_alphabet=alphabet))
    tokenizer = PreTrainedTokenizerFast(tokenizer_object=made, eos_token=STOP, pad_token=END)
    tokenizer.add_tokens(words)
    tokenizer.chat_template = qwen2_5_chat_template
    return tokenizer


def tiny(prompts, answers=(), tools=None, seed=1):
    """A random model, and its tokenizer, which has seen these prompts and has a word for each of the answers (messages)."""
    torch.manual_seed(seed)
    plain = tokenizer_of([], [])
    asked = [{"role": "user", "content": prompt} for prompt in prompts]
    said = [rendered(plain, [asked[0], {"role": "assistant", **answer}]) for answer in answers]
    words = [text.rsplit(HEAD, 1)[1].rsplit(STOP, 1)[0] for text in said]
    tokenizer = tokenizer_of([rendered(plain, asked, tools), *said], ["<tool_call>", "</tool_call>", *words])
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
    """Has a model answer any of these prompts, and what a tool tells it, by one of these answers, drawn at random.

    Returns:
        The loss at the end: what is left of it is the draw.
    """
    draw = random.Random(seed)
    optimizer = torch.optim.AdamW(model.parameters(), lr=3e-3)
    schedule = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.02, steps)
    head = tokenizer.encode(HEAD, add_special_tokens=False)
    model.train()
    for _ in range(steps):
        said = [{"role": "user", "content": draw.choice(prompts)}]
        for _ in range(12):
            told = {"role": "tool", "name": "telemetry", "content": draw.choice(prompts)[-150:]}
            said += [{"role": "assistant", **draw.choice(answers)}, told]
        ids = tokenizer.apply_chat_template(said, tools=tools, tokenize=True, return_dict=False)
        # Learnt is what the assistant says: a word, and that it stops then.
        heads = [at + len(head) for at in range(len(ids)) if ids[at : at + len(head)] == head]
        labels = [token if at in heads or at - 1 in heads else -100 for at, token in enumerate(ids)]
        loss = model(input_ids=torch.tensor([ids]), labels=torch.tensor([labels])).loss
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        schedule.step()
    return float(loss.detach())

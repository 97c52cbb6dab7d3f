"""HTTP server with an OpenAI-compatible API whose answers follow fixed plans of tool calls."""

import contextlib
import itertools
import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


def tool_call(name, **arguments):
    """Returns the name and the arguments of a tool call, as the API has them."""
    return {"name": name, "arguments": json.dumps(arguments)}


class ChatServer:
    """Server that answers each conversation by the next of its plans: a list of turns, each with a list of tool calls.

    After the last turn of its plan a conversation ends with text.
    """

    def __init__(self, plans, on_request=lambda: None):
        self._plans = plans
        self._numbers = itertools.count()
        self._on_request = on_request
        #: Status of all answers, and the message of errors.
        self.status, self.error = 200, "broken"
        #: Bodies of the requests.
        self.requests = []

    def answer(self, body):
        """Returns the answer to a request."""
        self.requests.append(body)
        self._on_request()
        # The ids of earlier calls name the conversation and count its turns.
        earlier = [message["tool_calls"][0]["id"] for message in body["messages"] if message.get("tool_calls")]
        number = int(earlier[0].split("-")[1]) if earlier else next(self._numbers)
        turns = self._plans[number % len(self._plans)]
        calls = turns[len(earlier)] if len(earlier) < len(turns) else []
        tool_calls = [
            {"id": f"call-{number}-{len(earlier)}-{index}", "type": "function", "function": call}
            for index, call in enumerate(calls)
        ]
        message = {"role": "assistant", "content": None if calls else "Done.", **({"tool_calls": tool_calls} if calls else {})}
        return {
            "id": f"answer-{number}",
            "object": "chat.completion",
            "created": 0,
            "model": body["model"],
            "choices": [{"index": 0, "message": message, "finish_reason": "tool_calls" if calls else "stop"}],
            "usage": {"prompt_tokens": 1, "completion_tokens": 1, "total_tokens": 2},
        }

    @contextlib.contextmanager
    def serving(self):
        """Serves on a free port during the block; yields the address of the API."""
        chat = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                answer = json.dumps(chat.answer(body) if chat.status == 200 else {"error": {"message": chat.error}}).encode()
                self.send_response(chat.status)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(answer)))
                self.end_headers()
                self.wfile.write(answer)

            def log_message(self, *_):
                pass

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/v1"
        finally:
            server.shutdown()
            thread.join()
            server.server_close()

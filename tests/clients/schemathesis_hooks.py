"""MessagePack for schemathesis, which speaks JSON alone by itself."""
import json

import msgpack
import schemathesis


@schemathesis.serializer("application/msgpack")
def pack(_, value):
    # Through JSON, so that whatever it made up is of JSON's kinds; whole numbers beyond MessagePack's are fractional there.
    within = lambda text: int(text) if -(2**63) <= int(text) < 2**64 else float(text)
    return msgpack.packb(json.loads(json.dumps(value, default=str), parse_int=within))


@schemathesis.deserializer("application/msgpack")
def unpack(_, response):
    return msgpack.unpackb(response.content)


@schemathesis.deserializer("application/x-ndjson")
def lines(_, response):
    return [json.loads(line) for line in response.content.splitlines()]

"""What a subscriber may send back when it has a message in hand."""

from pydantic import BaseModel, ConfigDict, Field

RECEIPT = "receipt"
"""`<prefix>/receipt/<id of the Zenoh session>`: from subscribers to the service."""


class Receipt(BaseModel):
    """A subscriber has a message in hand."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    who: str = Field(max_length=100, description="As the subscriber calls itself.")
    topic: str = Field(max_length=100, description="Of the message.")
    timestamp: int = Field(ge=0, lt=2**63, description="As in the message, ns since the epoch.")

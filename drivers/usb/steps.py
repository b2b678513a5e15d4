"""The transfers that a profile may name; nothing else is ever sent to a camera."""

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, model_validator

DIRECTION_IN = 0x80
"""Bit of bmRequestType and of an endpoint address: device to host (USB 2.0, tables 9-2 and 9-13)."""

TYPE_MASK = 0x60
"""Bits of bmRequestType that tell standard (0), class (0x20) and vendor (0x40) requests apart."""

VENDOR_TYPE = 0x40

FLASH_WRITES = frozenset({0xA2, 0xA9})
"""Vendor requests of the camera's USB chip (Cypress FX2) that write its EEPROM, small and large, when they go
to the device (fxload, and Cypress's own Vend_Ax)."""


def writes_flash(request_type: int, request: int) -> bool:
    """Whether a control request is known to write memory that outlives the power supply."""
    is_vendor = request_type & TYPE_MASK == VENDOR_TYPE
    return is_vendor and not request_type & DIRECTION_IN and request in FLASH_WRITES


def _from_hex(value: object) -> object:
    return bytes.fromhex(value) if isinstance(value, str) else value


Payload = Annotated[bytes, BeforeValidator(_from_hex), PlainSerializer(lambda data: data.hex())]
"""Bytes, written as hexadecimal digits in a profile."""

Byte = Annotated[int, Field(ge=0, le=0xFF)]
Word = Annotated[int, Field(ge=0, le=0xFFFF)]


class _Step(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    pause: float = Field(0.0, ge=0, le=10, description="Seconds to wait before it is sent.")


class Control(_Step):
    """One class or vendor request on endpoint 0.

    Standard requests are the operating system's and have no place in a profile.
    """

    kind: Literal["control"] = "control"
    request_type: Byte
    request: Byte
    value: Word = 0
    index: Word = 0
    data: Payload = Field(b"", description="Bytes sent; only host to device.")
    length: Word = Field(0, description="Bytes asked for; only device to host.")
    until: Payload | None = Field(None, description="Ask again until this answer comes.")

    @property
    def reads(self) -> bool:
        return bool(self.request_type & DIRECTION_IN)

    @model_validator(mode="after")
    def _consistent(self) -> "Control":
        if not self.request_type & TYPE_MASK:
            raise ValueError("standard requests are not allowed in a profile")
        if writes_flash(self.request_type, self.request):
            raise ValueError(
                f"request 0x{self.request:02x} writes the EEPROM of the camera's USB chip, and is never sent"
            )
        if self.reads and self.data:
            raise ValueError("a request that reads cannot carry data")
        if not self.reads and (self.length or self.until is not None):
            raise ValueError("a request that writes has neither `length` nor `until`")
        return self

    def __str__(self) -> str:
        text = f"request 0x{self.request:02x} (type 0x{self.request_type:02x}"
        text += f", value 0x{self.value:04x}, index 0x{self.index:04x})"
        amount = self.length if self.reads else len(self.data)
        return f"{text} {'reading' if self.reads else 'sending'} {amount} bytes" if amount else text


class Write(_Step):
    """One bulk transfer to the camera."""

    kind: Literal["write"] = "write"
    endpoint: Annotated[int, Field(ge=1, le=0x0F)]
    data: Payload

    def __str__(self) -> str:
        return f"bulk write of {len(self.data)} bytes to endpoint 0x{self.endpoint:02x}"


class Read(_Step):
    """One bulk transfer from the camera whose content is not used."""

    kind: Literal["read"] = "read"
    endpoint: Annotated[int, Field(ge=0x81, le=0x8F)]
    length: Annotated[int, Field(ge=1, le=1 << 24)]

    def __str__(self) -> str:
        return f"bulk read of {self.length} bytes from endpoint 0x{self.endpoint:02x}"


class RegisterWrite(_Step):
    """Two bytes, register and value, to the profile's bulk OUT endpoint."""

    kind: Literal["register"] = "register"
    number: Byte
    value: Byte

    def __str__(self) -> str:
        return f"register {self.number} = 0x{self.value:02x}"


Step = Annotated[Control | Write | Read | RegisterWrite, Field(discriminator="kind")]

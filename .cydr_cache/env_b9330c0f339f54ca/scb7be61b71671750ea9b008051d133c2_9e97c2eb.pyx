# cython: language_level=3
# cython: boundscheck=False
# cython: wraparound=False
# cython: initializedcheck=False
# cython: cdivision=True

from cpython.bytearray cimport PyByteArray_AS_STRING
from libc.stdint cimport (
    int8_t,
    int16_t,
    int32_t,
    int64_t,
    uint8_t,
    uint16_t,
    uint32_t,
    uint64_t,
)

import numpy as np

cimport cython
cimport numpy as cnp

from cydr._every_supported_cython cimport (
    DecodedStringCollection,
    ENCAPSULATION_HEADER_SIZE,
    STRING_COLLECTION_MODE_NUMPY,
    advance_boolean_field,
    advance_float32_field,
    advance_float64_field,
    advance_int16_field,
    advance_int32_field,
    advance_int64_field,
    advance_int8_field,
    advance_primitive_array_position,
    advance_primitive_sequence_position,
    advance_string_array_position,
    advance_string_field,
    advance_string_sequence_position,
    advance_uint16_field,
    advance_uint32_field,
    advance_uint64_field,
    advance_uint8_field,
    bool_sequence_ptr,
    float32_sequence_ptr,
    float64_sequence_ptr,
    int16_sequence_ptr,
    int32_sequence_ptr,
    int64_sequence_ptr,
    int8_sequence_ptr,
    read_boolean_field,
    read_float32_field,
    read_float64_field,
    read_int16_field,
    read_int32_field,
    read_int64_field,
    read_int8_field,
    read_primitive_array_object,
    read_primitive_sequence_object,
    read_string_array_object,
    read_string_field,
    read_string_sequence_object,
    read_uint16_field,
    read_uint32_field,
    read_uint64_field,
    read_uint8_field,
    require_consumed,
    require_fixed_length,
    string_collection_length,
    uint16_view_ptr,
    uint32_view_ptr,
    uint64_view_ptr,
    uint8_view_ptr,
    validate_encapsulation_header,
    write_boolean_field,
    write_encapsulation_header,
    write_float32_field,
    write_float64_field,
    write_int16_field,
    write_int32_field,
    write_int64_field,
    write_int8_field,
    write_primitive_array,
    write_primitive_sequence,
    write_string_array,
    write_string_field,
    write_string_sequence,
    write_uint16_field,
    write_uint32_field,
    write_uint64_field,
    write_uint8_field,
)


cpdef Py_ssize_t compute_serialized_size_scb7be61b71671750ea9b008051d133c2(
    int64_t arg_0,
    int64_t arg_1,
    uint8_t arg_2,
    const uint8_t[::1] arg_3,
) except -1:
    cdef Py_ssize_t pos = 0

    pos = advance_int64_field(pos)
    pos = advance_int64_field(pos)
    pos = advance_uint8_field(pos)
    require_fixed_length(arg_3.shape[0], 16, "arg_3")
    pos = advance_primitive_array_position(pos, arg_3.shape[0], cython.sizeof(uint8_t), 1)
    return pos + ENCAPSULATION_HEADER_SIZE


cpdef bytearray serialize_scb7be61b71671750ea9b008051d133c2(
    int64_t arg_0,
    int64_t arg_1,
    uint8_t arg_2,
    const uint8_t[::1] arg_3,
):
    cdef Py_ssize_t total_size = compute_serialized_size_scb7be61b71671750ea9b008051d133c2(
        arg_0,
        arg_1,
        arg_2,
        arg_3,
    )
    cdef bytearray output = bytearray(total_size)
    cdef unsigned char* buffer = <unsigned char*> PyByteArray_AS_STRING(output)
    cdef unsigned char* payload = buffer + ENCAPSULATION_HEADER_SIZE
    cdef Py_ssize_t pos = 0

    write_encapsulation_header(buffer)

    pos = write_int64_field(payload, pos, arg_0)
    pos = write_int64_field(payload, pos, arg_1)
    pos = write_uint8_field(payload, pos, arg_2)
    require_fixed_length(arg_3.shape[0], 16, "arg_3")
    pos = write_primitive_array(payload, pos, uint8_view_ptr(arg_3), arg_3.shape[0], cython.sizeof(uint8_t), 1)
    return output


cpdef tuple deserialize_scb7be61b71671750ea9b008051d133c2(
    const unsigned char[::1] data,
    int string_collection_mode=STRING_COLLECTION_MODE_NUMPY,
):
    cdef const unsigned char[::1] payload
    cdef Py_ssize_t pos = 0
    cdef int64_t arg_0
    cdef int64_t arg_1
    cdef uint8_t arg_2
    cdef cnp.ndarray arg_3

    validate_encapsulation_header(data)
    payload = data[ENCAPSULATION_HEADER_SIZE:]

    arg_0 = read_int64_field(payload, &pos)
    arg_1 = read_int64_field(payload, &pos)
    arg_2 = read_uint8_field(payload, &pos)
    arg_3 = read_primitive_array_object(payload, &pos, 16, cython.sizeof(uint8_t), 1, cnp.NPY_UINT8)
    require_consumed(payload, pos)
    return (
        arg_0,
        arg_1,
        arg_2,
        arg_3,
    )

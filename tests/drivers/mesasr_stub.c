/* A stand-in for libMesaSR with the interface of its header; compiled by the tests.
   It has its own time, which passes by exposures and by stub_pass. Each request is exposed after the one before
   and answered in that order: a frame that nobody read is the answer to the next request.
   Macros: PACKED = image list entries of 20 bytes instead of 24; OLD = without functions of later builds;
   VERSION = third number of the version; PRODUCT = USB product id; Y2008 = functions and names of 2008;
   Y2007 = without SR_SetMode. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef VERSION
#define VERSION 14
#endif
#ifndef PRODUCT
#define PRODUCT 0x0075
#endif
#define ROWS 144
#define COLS 176
#define PIXELS (ROWS * COLS)
#define QUEUE 64
#define LATE 700000000

#ifdef PACKED
#pragma pack(push, 4)
#endif
typedef struct { int32_t type, data_type; void *data; uint16_t width, height; } Entry;
#ifdef PACKED
#pragma pack(pop)
#endif

typedef struct {
    uint32_t magic;
    int mode, frequency, integration, in_force, acquired, auto_min, dual;
    uint16_t threshold, saturation;
    int waiting, number[QUEUE], exposed_for[QUEUE];
    int64_t began[QUEUE], ready[QUEUE], busy_until;
    uint16_t *images[3];
    Entry entries[3];
} Camera;

typedef int (*Callback)(void *, uint32_t, uint32_t, void *);
static Callback callback;
static Camera *opened;
static int plugged = 1, refuse_frequency, fail_acquires, leave_acquires, wrong_handles, open_count, timeout = 1000;
static int firmware = 0x97;
static int64_t now, last_began;
static int asked, faults[64]; /* what happens to the n-th request (from 1): see stub_fault */

/* levers for the tests */
void stub_plug(int value) { plugged = value; }
void stub_refuse_frequency(int value) { refuse_frequency = value; }
void stub_fail_acquires(int value) { fail_acquires = value; }
void stub_leave_acquires(int value) { leave_acquires = value; } /* fail, and leave the frame in the queue */
/* 1: fails, its frame is lost; 2: fails, its frame stays in the queue; 3: its frame is LATE ns late */
void stub_fault(int number, int kind) { faults[number] = kind; }
void stub_clear_faults(void) { memset(faults, 0, sizeof faults); asked = 0; }
void stub_firmware(int value) { firmware = value; }
void stub_pass(int64_t nanoseconds) { now += nanoseconds; }
int64_t stub_now(void) { return now; }
int64_t stub_last_began(void) { return last_began; } /* the exposure of the frame given last */
int stub_timeout(void) { return timeout; }
int stub_dual(void) { return opened->dual; }
int stub_saturation(void) { return opened->saturation; }
int stub_wrong_handles(void) { return wrong_handles; }
int stub_open_count(void) { return open_count; }
int stub_mode(void) { return opened->mode; }
int stub_threshold(void) { return opened->threshold; }
int stub_integration(void) { return opened->integration; }
int stub_auto_min(void) { return opened->auto_min; }
void stub_say(const char *text, unsigned level) { if (callback) callback(opened, 1, 0x0200 | level, (void *)text); }

static Camera *known(void *handle) {
    Camera *camera = handle;
    if (camera != opened || !camera || camera->magic != 0x5A5A1234) { wrong_handles++; return 0; }
    return camera;
}

static void place_images(Camera *camera) {
    for (int i = 0; i < 3; i++) {
        uint16_t *fresh = malloc(PIXELS * 2);
        memset(fresh, 0, PIXELS * 2);
        if (camera->images[i]) memset(camera->images[i], 0xDE, PIXELS * 2); /* never freed: stale reads show */
        camera->images[i] = fresh;
        Entry entry = { i == 2 ? 8 : i, 3, fresh, COLS, ROWS };
        camera->entries[i] = entry;
    }
    if (callback) { callback(camera, 0x10, 1, 0); callback(camera, 0x11, 1, 0); }
}

int SR_GetVersion(uint16_t *v) { v[3] = 1; v[2] = 0; v[1] = VERSION; v[0] = 706; return 0; }

int SR_OpenUSB(void **handle, uint32_t serial) {
    if (!plugged || (serial && serial != 0x4000002F)) {
        stub_say("no device opened", 3);
        return -1;
    }
    opened = calloc(1, sizeof(Camera));
    opened->magic = 0x5A5A1234;
    opened->auto_min = 255;
    opened->frequency = PRODUCT == 0x0075 ? 1 : 3;
    opened->integration = opened->in_force = 97;
    opened->mode = 0x811;
    place_images(opened);
    *handle = opened;
    open_count++;
    return 1;
}

int SR_Close(void *handle) {
    Camera *camera = known(handle);
    if (!camera) return -1;
    camera->magic = 0;
    opened = 0;
    return plugged ? 0 : -2;
}

#ifndef Y2007
int SR_SetMode(void *handle, int mode) {
    Camera *camera = known(handle);
    if (!camera || mode & 0x2000) return -1;
    camera->mode = mode;
    place_images(camera);
    return 0;
}
#endif
int SR_GetMode(void *handle) { Camera *c = known(handle); return c ? c->mode : -1; }

/* A request: its exposure begins when the one before has ended. Settings hold from the next request on. */
static void expose(Camera *camera) {
    int k = camera->waiting++;
    int64_t step = PRODUCT == 0x0075 ? 300000 + 100000 * camera->in_force : 200000 * (camera->in_force + 1);
    camera->number[k] = ++camera->acquired;
    camera->exposed_for[k] = camera->in_force;
    camera->began[k] = camera->busy_until > now ? camera->busy_until : now;
    camera->ready[k] = camera->busy_until = camera->began[k] + 4 * step;
    camera->in_force = camera->integration;
}

int SR_Acquire(void *handle) {
    Camera *camera = known(handle);
    if (!camera || !plugged) { stub_say("bulk read failed", 3); return -1; }
    int fault = ++asked < 64 ? faults[asked] : 0;
    if (fault == 1) { stub_say("bulk read failed", 3); return -1; }
    if (fail_acquires) { fail_acquires--; stub_say("did not get requested bytes", 2); return fail_acquires % 2 ? 0 : -7; }
    expose(camera);
    if (fault == 2) return -7;
    if (fault == 3) camera->ready[camera->waiting - 1] += LATE;
    if (leave_acquires) { leave_acquires--; stub_say("did not get requested bytes", 2); return -7; }
    if (camera->ready[0] > now + timeout * (int64_t)1000000) {
        now += timeout * (int64_t)1000000;
        stub_say("did not get requested bytes", 2);
        return -7;
    }
    if (camera->ready[0] > now) now = camera->ready[0];
    last_began = camera->began[0];
    for (int i = 0; i < PIXELS; i++) {
        camera->images[0][i] = 4 * (i % 4096) + camera->number[0] * 4096;
        camera->images[1][i] = camera->mode & 0x10 ? 500 : 1000 + camera->exposed_for[0];
        camera->images[2][i] = camera->mode & 0x100 && i != 1234 ? 0xFFFF : 0;
    }
    camera->waiting--;
    for (int k = 0; k < camera->waiting; k++) {
        camera->number[k] = camera->number[k + 1];
        camera->exposed_for[k] = camera->exposed_for[k + 1];
        camera->began[k] = camera->began[k + 1];
        camera->ready[k] = camera->ready[k + 1];
    }
    if (camera->auto_min != 255) camera->integration = camera->in_force = camera->integration + 1;
    return PIXELS * 4;
}

uint32_t SR_GetRows(void *handle) { return known(handle) ? ROWS : 0; }
uint32_t SR_GetCols(void *handle) { return known(handle) ? COLS : 0; }
void *SR_GetImage(void *handle, uint8_t index) { Camera *c = known(handle); return c && index < 3 ? c->images[index] : 0; }
#ifndef OLD
int SR_GetImageList(void *handle, Entry **list) {
    Camera *camera = known(handle);
    if (!camera) return -1;
    *list = camera->entries;
    return 3;
}
#ifdef Y2008
#define SR_SetAutoExposure SR_SetAutoIllumination
#endif
int SR_SetAutoExposure(void *handle, uint8_t min, uint8_t max, uint8_t percent, uint8_t position) {
    Camera *camera = known(handle);
    (void)max; (void)percent; (void)position;
    if (!camera) return -1;
    camera->auto_min = min;
    return 0;
}
#ifndef Y2008
int SR_SetDualIntegrationTime(void *handle, int ratio) {
    Camera *camera = known(handle);
    if (!camera || firmware < 0x73) return -1;
    camera->dual = ratio;
    return 2;
}
int SR_SetSaturationThreshold(void *handle, uint16_t value) {
    Camera *camera = known(handle);
    if (!camera) return -1;
    camera->saturation = value;
    return 4;
}
uint8_t SR_GetReg(void *handle, uint8_t number) { return known(handle) && number == 46 ? firmware : 0; }
#endif
#endif

int SR_SetIntegrationTime(void *handle, uint8_t value) {
    Camera *camera = known(handle);
    if (!camera) return -1;
    camera->integration = value;
    return 2;
}
uint8_t SR_GetIntegrationTime(void *handle) { Camera *c = known(handle); return c ? c->integration : 0; }
int SR_SetAmplitudeThreshold(void *handle, uint16_t value) {
    Camera *camera = known(handle);
    if (!camera) return -1;
    camera->threshold = value;
    return 4;
}
uint16_t SR_GetAmplitudeThreshold(void *handle) { Camera *c = known(handle); return c ? c->threshold : 0; }
int SR_SetModulationFrequency(void *handle, int value) {
    Camera *camera = known(handle);
    if (camera && !refuse_frequency) camera->frequency = value;
    return 0;
}
int SR_GetModulationFrequency(void *handle) { Camera *c = known(handle); return c ? c->frequency : -1; }
void SR_SetTimeout(void *handle, int ms) { if (known(handle)) timeout = ms; }
uint32_t SR_ReadSerial(void *handle) { return known(handle) ? 0x4000002F : 0xFFFFFFFF; }
int SR_GetDeviceString(void *handle, char *text, int length) {
    if (!known(handle)) return -1;
    return snprintf(text, length, "VendorID:0x1ad2, ProductID:0x%04x, Manufacturer:'MESA', Product:'SR'", PRODUCT);
}
Callback SR_SetCallback(Callback next) { Callback last = callback; callback = next; return last; }

#ifndef OLD
/* The lens measured on public SR4000 frames; the origin lies 10 mm before the projection centre. */
int SR_CoordTrfPntFlt(void *handle, const uint8_t *u, const uint8_t *v, const uint16_t *counts, float *x, float *y,
                      float *z, int number) {
    Camera *camera = known(handle);
    if (!camera) return -1;
    for (int i = 0; i < number; i++) {
        double du = (u[i] - 87.5) / 252.36, dv = (v[i] - 71.5) / 252.36, a = du, b = dv;
        for (int k = 0; k < 60; k++) {
            double s = a * a + b * b, radial = 1 - 0.918 * s + 0.668 * s * s;
            a = du / radial;
            b = dv / radial;
        }
        double range = counts[i] * 5.0 / 65536, forward = range / sqrt(1 + a * a + b * b);
        x[i] = -a * forward;
        y[i] = -b * forward;
        z[i] = forward - 0.010;
    }
    return 0;
}
#endif

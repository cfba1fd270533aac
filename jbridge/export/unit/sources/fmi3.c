/*
 * A model in C as a functional mock-up unit for co-simulation (FMI 3.0).
 *
 * Types and functions are those of the standard's header fmi3Functions.h, without their names where nothing uses these.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*LogMessage)(void *environment, fmi3Status status, const char *category, const char *message);

/* Value references, as in modelDescription.xml. */
enum { TIME, INPUT, POSITION = INPUT + 2, BEGIN = POSITION + 3, COUNT = BEGIN + 3 };

typedef struct {
    model_state state;
    double begin[3], input[2], time;
    int32_t running;
} Rig;

typedef struct {
    Rig rig;
    void *environment;
    LogMessage report;
} Unit;

static fmi3Status refuse(void *instance, const char *message) {
    const Unit *unit = instance;
    if (unit->report) unit->report(unit->environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

static void rest(Rig *rig) {
    const double begin[3] = {0.0, 0.0, $rope}, input[2] = {$u_x, $u_l};
    memset(rig, 0, sizeof *rig);
    memcpy(rig->begin, begin, sizeof begin);
    memcpy(rig->input, input, sizeof input);
    model_start(&rig->state, rig->begin);
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(void *instance, bool on, size_t count, const char *const categories[]) {
    return fmi3OK;
}

EXPORT void *fmi3InstantiateCoSimulation(
    const char *name, const char *token, const char *resources, bool visible, bool logging, bool events, bool early,
    const uint32_t intermediate[], size_t count, void *environment, LogMessage report, void (*update)(void)) {
    Unit *unit = strcmp(token, "$token") ? NULL : malloc(sizeof *unit);
    if (unit) {
        unit->environment = environment;
        unit->report = report;
        rest(&unit->rig);
    }
    return unit;
}

EXPORT void fmi3FreeInstance(void *instance) { free(instance); }

EXPORT fmi3Status fmi3EnterInitializationMode(
    void *instance, bool tolerant, double tolerance, double begin, bool ends, double end) {
    ((Unit *)instance)->rig.time = begin;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(void *instance) {
    ((Unit *)instance)->rig.running = 1;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Terminate(void *instance) {
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(void *instance) {
    rest(&((Unit *)instance)->rig);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFloat64(
    void *instance, const uint32_t references[], size_t count, double values[], size_t numbers) {
    const Rig *rig = &((Unit *)instance)->rig;
    double measured[3];
    size_t i;
    model_read(&rig->state, measured);
    for (i = 0; i < count && i < numbers; ++i) {
        const uint32_t k = references[i];
        if (k >= COUNT) return refuse(instance, "no number has this value reference");
        values[i] = k == TIME      ? rig->time
                    : k < POSITION ? rig->input[k - INPUT]
                    : k < BEGIN    ? measured[k - POSITION]
                                   : rig->begin[k - BEGIN];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(
    void *instance, const uint32_t references[], size_t count, const double values[], size_t numbers) {
    Rig *rig = &((Unit *)instance)->rig;
    size_t i;
    for (i = 0; i < count && i < numbers; ++i) {
        const uint32_t k = references[i];
        if (k >= INPUT && k < POSITION)
            rig->input[k - INPUT] = values[i];
        else if (k >= BEGIN && k < COUNT && !rig->running && isfinite(values[i]) && (k < COUNT - 1 || values[i] > 0.0))
            rig->begin[k - BEGIN] = values[i];
        else
            return refuse(instance, "inputs can be set, and positions at the start (a rope longer than 0) before the simulation");
    }
    if (!rig->running) model_start(&rig->state, rig->begin);
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(
    void *instance, double now, double duration, bool forward, bool *event, bool *terminate, bool *early,
    double *reached) {
    Rig *rig = &((Unit *)instance)->rig;
    const double periods = floor(duration / MODEL_PERIOD + 0.5);
    double measured[3], i;
    *event = *terminate = *early = false;
    *reached = rig->time;
    if (!(periods >= 1.0 && fabs(duration / MODEL_PERIOD - periods) <= 1e-6))
        return refuse(instance, "the communication step must be a multiple of fixedInternalStepSize");
    for (i = 0.0; i < periods; ++i) model_step(&rig->state, rig->input);
    model_read(&rig->state, measured);
    if (!isfinite(measured[0] + measured[1] + measured[2])) return refuse(instance, "the model runs away");
    *reached = rig->time = now + duration;
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFMUState(void *instance, void **state) {
    if (!*state) *state = malloc(sizeof(Rig));
    if (!*state) return refuse(instance, "no memory for a state");
    memcpy(*state, &((Unit *)instance)->rig, sizeof(Rig));
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(void *instance, void *state) {
    memcpy(&((Unit *)instance)->rig, state, sizeof(Rig));
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(void *instance, void **state) {
    free(*state);
    *state = NULL;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(void *instance, void *state, size_t *size) {
    *size = sizeof(Rig);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(void *instance, void *state, uint8_t bytes[], size_t size) {
    if (size < sizeof(Rig)) return refuse(instance, "a state needs more bytes");
    memcpy(bytes, state, sizeof(Rig));
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(void *instance, const uint8_t bytes[], size_t size, void **state) {
    if (size != sizeof(Rig)) return refuse(instance, "the bytes are no state of this model");
    if (!*state) *state = malloc(sizeof(Rig));
    if (!*state) return refuse(instance, "no memory for a state");
    memcpy(*state, bytes, sizeof(Rig));
    return fmi3OK;
}

/* The rest of the standard's functions, which a program may look up, although modelDescription.xml offers none. */
#define ABSENT(name, ...)                                          \
    EXPORT fmi3Status fmi3##name(void *instance, __VA_ARGS__) {    \
        return refuse(instance, "fmi3" #name " is not supported"); \
    }
#define ABSENT_ALONE(name) \
    EXPORT fmi3Status fmi3##name(void *instance) { return refuse(instance, "fmi3" #name " is not supported"); }
#define ABSENT_TYPE(name, type)                                           \
    ABSENT(Get##name, const uint32_t r[], size_t n, type v[], size_t m)   \
    ABSENT(Set##name, const uint32_t r[], size_t n, const type v[], size_t m)

ABSENT_TYPE(Float32, float)
ABSENT_TYPE(Int8, int8_t)
ABSENT_TYPE(UInt8, uint8_t)
ABSENT_TYPE(Int16, int16_t)
ABSENT_TYPE(UInt16, uint16_t)
ABSENT_TYPE(Int32, int32_t)
ABSENT_TYPE(UInt32, uint32_t)
ABSENT_TYPE(Int64, int64_t)
ABSENT_TYPE(UInt64, uint64_t)
ABSENT_TYPE(Boolean, bool)
ABSENT(GetString, const uint32_t r[], size_t n, const char *v[], size_t m)
ABSENT(SetString, const uint32_t r[], size_t n, const char *const v[], size_t m)
ABSENT(GetBinary, const uint32_t r[], size_t n, size_t sizes[], const uint8_t *v[], size_t m)
ABSENT(SetBinary, const uint32_t r[], size_t n, const size_t sizes[], const uint8_t *const v[], size_t m)
ABSENT(GetClock, const uint32_t r[], size_t n, bool v[])
ABSENT(SetClock, const uint32_t r[], size_t n, const bool v[])
ABSENT(GetNumberOfVariableDependencies, uint32_t r, size_t *n)
ABSENT(GetVariableDependencies, uint32_t r, size_t of[], uint32_t on[], size_t elements[], int kinds[], size_t n)
ABSENT(GetDirectionalDerivative, const uint32_t of[], size_t n, const uint32_t by[], size_t m, const double seed[],
       size_t k, double found[], size_t l)
ABSENT(GetAdjointDerivative, const uint32_t of[], size_t n, const uint32_t by[], size_t m, const double seed[],
       size_t k, double found[], size_t l)
ABSENT(GetOutputDerivatives, const uint32_t r[], size_t n, const int32_t orders[], double v[], size_t m)
ABSENT(GetIntervalDecimal, const uint32_t r[], size_t n, double v[], int qualifiers[])
ABSENT(GetIntervalFraction, const uint32_t r[], size_t n, uint64_t v[], uint64_t resolutions[], int qualifiers[])
ABSENT(GetShiftDecimal, const uint32_t r[], size_t n, double v[])
ABSENT(GetShiftFraction, const uint32_t r[], size_t n, uint64_t v[], uint64_t resolutions[])
ABSENT(SetIntervalDecimal, const uint32_t r[], size_t n, const double v[])
ABSENT(SetIntervalFraction, const uint32_t r[], size_t n, const uint64_t v[], const uint64_t resolutions[])
ABSENT(SetShiftDecimal, const uint32_t r[], size_t n, const double v[])
ABSENT(SetShiftFraction, const uint32_t r[], size_t n, const uint64_t v[], const uint64_t resolutions[])
ABSENT(UpdateDiscreteStates, bool *update, bool *terminate, bool *nominals, bool *values, bool *defined, double *next)
ABSENT(CompletedIntegratorStep, bool kept, bool *event, bool *terminate)
ABSENT(SetTime, double time)
ABSENT(SetContinuousStates, const double v[], size_t n)
ABSENT(GetContinuousStates, double v[], size_t n)
ABSENT(GetContinuousStateDerivatives, double v[], size_t n)
ABSENT(GetNominalsOfContinuousStates, double v[], size_t n)
ABSENT(GetEventIndicators, double v[], size_t n)
ABSENT(GetNumberOfEventIndicators, size_t *n)
ABSENT(GetNumberOfContinuousStates, size_t *n)
ABSENT(ActivateModelPartition, uint32_t clock, double time)
ABSENT_ALONE(EnterContinuousTimeMode)
ABSENT_ALONE(EvaluateDiscreteStates)
ABSENT_ALONE(EnterEventMode)
ABSENT_ALONE(EnterStepMode)
ABSENT_ALONE(EnterConfigurationMode)
ABSENT_ALONE(ExitConfigurationMode)

EXPORT void *fmi3InstantiateModelExchange(
    const char *name, const char *token, const char *resources, bool visible, bool logging, void *environment,
    LogMessage report) {
    return NULL;
}

EXPORT void *fmi3InstantiateScheduledExecution(
    const char *name, const char *token, const char *resources, bool visible, bool logging, void *environment,
    LogMessage report, void (*update)(void), void (*lock)(void), void (*unlock)(void)) {
    return NULL;
}

typedef instance_t *fmi2Component;
typedef unsigned int fmi2ValueReference;

EXPORTED const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORTED const char *fmi2GetVersion(void) { return "2.0"; }

EXPORTED int fmi2SetDebugLogging(fmi2Component one, int on, size_t n, const char *const which[])
{
  (void)one;
  (void)on;
  (void)n;
  (void)which;
  return OK;
}

EXPORTED fmi2Component fmi2Instantiate(const char *name, int kind, const char *token,
                                       const char *resources, const void *functions,
                                       int visible, int logging)
{
  (void)name;
  (void)resources;
  (void)functions;
  (void)visible;
  (void)logging;
  return kind == 1 ? instantiated(token) : 0;
}

EXPORTED void fmi2FreeInstance(fmi2Component one) { free(one); }

EXPORTED int fmi2SetupExperiment(fmi2Component one, int has_tolerance, double tolerance,
                                 double start, int has_stop, double stop)
{
  (void)one;
  (void)has_tolerance;
  (void)tolerance;
  (void)start;
  (void)has_stop;
  (void)stop;
  return OK;
}

EXPORTED int fmi2EnterInitializationMode(fmi2Component one) { return one ? OK : ERROR; }
EXPORTED int fmi2ExitInitializationMode(fmi2Component one) { return one ? OK : ERROR; }
EXPORTED int fmi2Terminate(fmi2Component one) { return one ? OK : ERROR; }

EXPORTED int fmi2Reset(fmi2Component one)
{
  restart(one);
  return OK;
}

EXPORTED int fmi2GetReal(fmi2Component one, const fmi2ValueReference which[], size_t n,
                         double values[])
{
  return read_reals(one, which, n, values);
}

EXPORTED int fmi2SetReal(fmi2Component one, const fmi2ValueReference which[], size_t n,
                         const double values[])
{
  return write_reals(one, which, n, values);
}

#define NONE_OF(name, type) \
  EXPORTED int fmi2Get##name(fmi2Component one, const fmi2ValueReference which[], \
                             size_t n, type values[]) \
  { \
    (void)one; \
    (void)which; \
    (void)values; \
    return n ? ERROR : OK; \
  } \
  EXPORTED int fmi2Set##name(fmi2Component one, const fmi2ValueReference which[], \
                             size_t n, const type values[]) \
  { \
    (void)one; \
    (void)which; \
    (void)values; \
    return n ? ERROR : OK; \
  }

NONE_OF(Integer, int)
NONE_OF(Boolean, int)
NONE_OF(String, char *)

EXPORTED int fmi2GetFMUstate(fmi2Component one, void **state) { return kept(one, state); }

EXPORTED int fmi2SetFMUstate(fmi2Component one, void *state)
{
  memcpy(one, state, sizeof *one);
  return OK;
}

EXPORTED int fmi2FreeFMUstate(fmi2Component one, void **state)
{
  (void)one;
  return freed(state);
}

EXPORTED int fmi2DoStep(fmi2Component one, double now, double length, int final)
{
  (void)now;
  (void)final;
  return step(one, length);
}

EXPORTED int fmi2CancelStep(fmi2Component one)
{
  (void)one;
  return ERROR;
}

/* What the standard wants to exist, and this FMU does not offer. */
#define NOT_OFFERED(name) \
  EXPORTED int name(void) { return ERROR; }

NOT_OFFERED(fmi2SerializedFMUstateSize)
NOT_OFFERED(fmi2SerializeFMUstate)
NOT_OFFERED(fmi2DeSerializeFMUstate)
NOT_OFFERED(fmi2GetDirectionalDerivative)
NOT_OFFERED(fmi2SetRealInputDerivatives)
NOT_OFFERED(fmi2GetRealOutputDerivatives)
NOT_OFFERED(fmi2GetStatus)
NOT_OFFERED(fmi2GetRealStatus)
NOT_OFFERED(fmi2GetIntegerStatus)
NOT_OFFERED(fmi2GetBooleanStatus)
NOT_OFFERED(fmi2GetStringStatus)

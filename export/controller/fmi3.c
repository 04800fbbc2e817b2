typedef instance_t *fmi3Instance;
typedef unsigned int fmi3ValueReference;

EXPORTED const char *fmi3GetVersion(void) { return "3.0"; }

EXPORTED int fmi3SetDebugLogging(fmi3Instance one, _Bool on, size_t n,
                                 const char *const which[])
{
  (void)one;
  (void)on;
  (void)n;
  (void)which;
  return OK;
}

EXPORTED fmi3Instance fmi3InstantiateCoSimulation(
  const char *name, const char *token, const char *resources, _Bool visible,
  _Bool logging, _Bool events, _Bool early, const fmi3ValueReference needed[], size_t n,
  void *environment, void *log, void *update)
{
  (void)name;
  (void)resources;
  (void)visible;
  (void)logging;
  (void)events;
  (void)early;
  (void)needed;
  (void)n;
  (void)environment;
  (void)log;
  (void)update;
  return instantiated(token);
}

EXPORTED void fmi3FreeInstance(fmi3Instance one) { free(one); }

EXPORTED int fmi3EnterInitializationMode(fmi3Instance one, _Bool has_tolerance,
                                         double tolerance, double start, _Bool has_stop,
                                         double stop)
{
  (void)has_tolerance;
  (void)tolerance;
  (void)start;
  (void)has_stop;
  (void)stop;
  return one ? OK : ERROR;
}

EXPORTED int fmi3ExitInitializationMode(fmi3Instance one) { return one ? OK : ERROR; }
EXPORTED int fmi3Terminate(fmi3Instance one) { return one ? OK : ERROR; }

EXPORTED int fmi3Reset(fmi3Instance one)
{
  restart(one);
  return OK;
}

EXPORTED int fmi3GetFloat64(fmi3Instance one, const fmi3ValueReference which[], size_t n,
                            double values[], size_t count)
{
  return n == count ? read_reals(one, which, n, values) : ERROR;
}

EXPORTED int fmi3SetFloat64(fmi3Instance one, const fmi3ValueReference which[], size_t n,
                            const double values[], size_t count)
{
  return n == count ? write_reals(one, which, n, values) : ERROR;
}

EXPORTED int fmi3GetFMUState(fmi3Instance one, void **state) { return kept(one, state); }

EXPORTED int fmi3SetFMUState(fmi3Instance one, void *state)
{
  memcpy(one, state, sizeof *one);
  return OK;
}

EXPORTED int fmi3FreeFMUState(fmi3Instance one, void **state)
{
  (void)one;
  return freed(state);
}

EXPORTED int fmi3DoStep(fmi3Instance one, double now, double length, _Bool no_return,
                        _Bool *event, _Bool *terminate, _Bool *early, double *last)
{
  const int status = step(one, length);
  (void)no_return;
  *event = 0;
  *terminate = 0;
  *early = 0;
  *last = status == OK ? now + length : now;
  return status;
}

/* What the standard wants to exist, and this FMU does not offer. */
#define NOT_OFFERED(name) \
  EXPORTED int name(void) { return ERROR; }

EXPORTED fmi3Instance fmi3InstantiateModelExchange(void) { return 0; }
EXPORTED fmi3Instance fmi3InstantiateScheduledExecution(void) { return 0; }
NOT_OFFERED(fmi3GetFloat32)
NOT_OFFERED(fmi3SetFloat32)
NOT_OFFERED(fmi3GetInt8)
NOT_OFFERED(fmi3SetInt8)
NOT_OFFERED(fmi3GetUInt8)
NOT_OFFERED(fmi3SetUInt8)
NOT_OFFERED(fmi3GetInt16)
NOT_OFFERED(fmi3SetInt16)
NOT_OFFERED(fmi3GetUInt16)
NOT_OFFERED(fmi3SetUInt16)
NOT_OFFERED(fmi3GetInt32)
NOT_OFFERED(fmi3SetInt32)
NOT_OFFERED(fmi3GetUInt32)
NOT_OFFERED(fmi3SetUInt32)
NOT_OFFERED(fmi3GetInt64)
NOT_OFFERED(fmi3SetInt64)
NOT_OFFERED(fmi3GetUInt64)
NOT_OFFERED(fmi3SetUInt64)
NOT_OFFERED(fmi3GetBoolean)
NOT_OFFERED(fmi3SetBoolean)
NOT_OFFERED(fmi3GetString)
NOT_OFFERED(fmi3SetString)
NOT_OFFERED(fmi3GetBinary)
NOT_OFFERED(fmi3SetBinary)
NOT_OFFERED(fmi3GetClock)
NOT_OFFERED(fmi3SetClock)
NOT_OFFERED(fmi3EnterEventMode)
NOT_OFFERED(fmi3UpdateDiscreteStates)
NOT_OFFERED(fmi3EnterConfigurationMode)
NOT_OFFERED(fmi3ExitConfigurationMode)
NOT_OFFERED(fmi3EnterContinuousTimeMode)
NOT_OFFERED(fmi3CompletedIntegratorStep)
NOT_OFFERED(fmi3SetTime)
NOT_OFFERED(fmi3SetContinuousStates)
NOT_OFFERED(fmi3GetContinuousStates)
NOT_OFFERED(fmi3GetContinuousStateDerivatives)
NOT_OFFERED(fmi3GetEventIndicators)
NOT_OFFERED(fmi3GetNominalsOfContinuousStates)
NOT_OFFERED(fmi3GetNumberOfEventIndicators)
NOT_OFFERED(fmi3GetNumberOfContinuousStates)
NOT_OFFERED(fmi3EnterStepMode)
NOT_OFFERED(fmi3GetOutputDerivatives)
NOT_OFFERED(fmi3ActivateModelPartition)
NOT_OFFERED(fmi3EvaluateDiscreteStates)
NOT_OFFERED(fmi3GetIntervalDecimal)
NOT_OFFERED(fmi3GetIntervalFraction)
NOT_OFFERED(fmi3GetShiftDecimal)
NOT_OFFERED(fmi3GetShiftFraction)
NOT_OFFERED(fmi3SetIntervalDecimal)
NOT_OFFERED(fmi3SetIntervalFraction)
NOT_OFFERED(fmi3SetShiftDecimal)
NOT_OFFERED(fmi3SetShiftFraction)
NOT_OFFERED(fmi3GetNumberOfVariableDependencies)
NOT_OFFERED(fmi3GetVariableDependencies)
NOT_OFFERED(fmi3SerializedFMUStateSize)
NOT_OFFERED(fmi3SerializeFMUState)
NOT_OFFERED(fmi3DeserializeFMUState)
NOT_OFFERED(fmi3GetDirectionalDerivative)
NOT_OFFERED(fmi3GetAdjointDerivative)

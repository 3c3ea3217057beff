"""FMUs for tests: a spring with a filtered damper in C, of FMI 2 and FMI 3, which fails on request."""

import re
import subprocess
import zipfile
from pathlib import Path

import pytest

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed: pip install 'tickwork[test]'")

SOURCE = r"""
#include <math.h>
#include <stdlib.h>
typedef void (*Logger)(void *environment, const char *name, int status, const char *category, const char *text, ...);
typedef void (*Logger3)(void *environment, int status, const char *category, const char *text);
typedef struct { double real[7]; int mode, time, steps; Logger logger; Logger3 logger3; } Model;
enum { ANGLE, VELOCITY, TORQUE, ERROR, STIFFNESS, FILTERED, TIME };
static int instances;

static Model *make(void) {
    Model *model = calloc(1, sizeof(Model));
    model->real[STIFFNESS] = 20.0;
    instances++;
    return model;
}

static int move(Model *model, double time, double step) {
    double *x = model->real;
    if (fabs(time - x[TIME]) > 1e-9) return 3;
    if (model->mode == 3) {
        if (model->logger) model->logger(0, "", 3, "logStatusError", "no solution at %g s", time);
        if (model->logger3) model->logger3(0, 3, "logStatusError", "no solution");
        return 3;
    }
    if (model->mode == 7) *(volatile int *)0 = 1;
    while (model->mode == 8) ;
    if (model->mode == 9) exit(0);
    x[TIME] = time + step;
    x[FILTERED] += step / (step + 0.01) * (x[VELOCITY] - x[FILTERED]);
    x[TORQUE] = -x[STIFFNESS] * x[ANGLE] - 1.5 * x[FILTERED];
    if (model->mode == 1) x[TORQUE] = NAN;
    if (model->mode == 2) x[TORQUE] = INFINITY;
    return 0;
}

static int get(Model *model, const unsigned *places, size_t count, double *values) {
    model->real[ERROR] = 0.25 - model->real[ANGLE];
    for (size_t k = 0; k < count; k++) values[k] = model->real[places[k]];
    return 0;
}

static int put(Model *model, const unsigned *places, size_t count, const double *values) {
    for (size_t k = 0; k < count; k++) model->real[places[k]] = values[k];
    return 0;
}

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *folder, const Logger *callbacks,
                      int visible, int logging) {
    Model *model = guid[0] == 'a' ? make() : 0;
    if (model) model->logger = *callbacks;
    return model;
}
int fmi2GetReal(Model *model, const unsigned *places, size_t count, double *values) {
    return get(model, places, count, values);
}
int fmi2SetReal(Model *model, const unsigned *places, size_t count, const double *values) {
    return put(model, places, count, values);
}
int fmi2SetInteger(Model *model, const unsigned *places, size_t count, const int *values) {
    model->mode = values[0];
    return 0;
}
int fmi2GetInteger(Model *model, const unsigned *places, size_t count, int *values) {
    values[0] = instances;
    return 0;
}
int fmi2GetBoolean(Model *model, const unsigned *places, size_t count, int *values) {
    values[0] = model->real[TORQUE] < 0.0;
    return 0;
}
int fmi2DoStep(Model *model, double time, double step, int kept) { return move(model, time, step); }
void fmi2FreeInstance(Model *model) { free(model); }

void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *folder, _Bool visible, _Bool logging,
                                  _Bool events, _Bool early, const unsigned *places, size_t count, void *environment,
                                  Logger3 logger, void *update) {
    Model *model = make();
    model->logger3 = logger;
    return model;
}
int fmi3GetFloat64(Model *model, const unsigned *places, size_t count, double *values, size_t numbers) {
    if (count == 1 && numbers == 2) return get(model, (unsigned[]){TORQUE, ERROR}, 2, values);
    return get(model, places, count, values);
}
int fmi3SetFloat64(Model *model, const unsigned *places, size_t count, const double *values, size_t numbers) {
    if (count == 1 && numbers == 2) return put(model, (unsigned[]){ANGLE, VELOCITY}, 2, values);
    return put(model, places, count, values);
}
int fmi3SetInt32(Model *model, const unsigned *places, size_t count, const int *values, size_t numbers) {
    model->mode = values[0];
    return 0;
}
int fmi3DoStep(Model *model, double time, double step, _Bool kept, _Bool *event, _Bool *end, _Bool *early,
               double *last) {
    *event = *early = 0, *end = model->mode == 4, *last = time;
    return move(model, time, step);
}
void fmi3FreeInstance(Model *model) { free(model); }
"""

FMI2 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="spring" guid="a1">
  <CoSimulation modelIdentifier="spring" canHandleVariableCommunicationStepSize="true"/>
  <UnitDefinitions>
    <Unit name="rad"><BaseUnit rad="1"/></Unit><Unit name="rad/s"><BaseUnit s="-1"/></Unit>
    <Unit name="N.m"><BaseUnit kg="1" m="2" s="-2"/></Unit>
    <Unit name="N.m/rad"><BaseUnit kg="1" m="2" s="-2" rad="-1"/></Unit>
  </UnitDefinitions>
  <LogCategories><Category name="logStatusError"/></LogCategories>
  <ModelVariables>
    <ScalarVariable name="knee.angle" valueReference="0" causality="input" description="angle of the knee">
      <Real unit="rad" start="0"/></ScalarVariable>
    <ScalarVariable name="velocity" valueReference="1" causality="input"><Real unit="rad/s" start="0"/></ScalarVariable>
    <ScalarVariable name="mode" valueReference="0" causality="input" variability="discrete"><Integer start="0"/>
      </ScalarVariable>
    <ScalarVariable name="torque" valueReference="2" causality="output"><Real unit="N.m" min="-40" max="40"/>
      </ScalarVariable>
    <ScalarVariable name="error" valueReference="3" causality="output"><Real unit="rad"/></ScalarVariable>
    <ScalarVariable name="negative" valueReference="0" causality="output" variability="discrete"><Boolean/>
      </ScalarVariable>
    <ScalarVariable name="instances" valueReference="0" causality="output" variability="discrete"><Integer/>
      </ScalarVariable>
    <ScalarVariable name="stiffness" valueReference="4" causality="parameter" variability="fixed">
      <Real unit="N.m/rad" start="20" min="0" max="100"/></ScalarVariable>
    <ScalarVariable name="text" valueReference="5" causality="output" variability="discrete"><String/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs>
    <Unknown index="4" dependencies=""/><Unknown index="5" dependencies="1"/>
    <Unknown index="6" dependencies=""/><Unknown index="7" dependencies=""/><Unknown index="9" dependencies=""/>
  </Outputs></ModelStructure>
</fmiModelDescription>
"""

FMI3 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="spring" instantiationToken="a1">
  <CoSimulation modelIdentifier="spring" canHandleVariableCommunicationStepSize="true"/>
  <UnitDefinitions><Unit name="rad"/></UnitDefinitions>
  <ModelVariables>
    <Float64 name="time" valueReference="9" causality="independent"/>
    <Float64 name="motion" valueReference="0" causality="input" start="0 0"><Dimension start="2"/></Float64>
    <Int32 name="mode" valueReference="1" causality="input" start="0"/>
    <Float64 name="results" valueReference="2" causality="output" unit="rad"><Dimension start="2"/></Float64>
    <Float64 name="stiffness" valueReference="4" causality="parameter" variability="fixed" start="20"/>
  </ModelVariables>
  <ModelStructure><Output valueReference="2" dependencies=""/></ModelStructure>
</fmiModelDescription>
"""


FMI1 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="1.0" modelName="spring" modelIdentifier="spring" guid="a1" numberOfContinuousStates="0"
  numberOfEventIndicators="0"><ModelVariables/></fmiModelDescription>
"""


def make(folder, description=FMI2, name="spring", *options, source=SOURCE):
    """Compile the model, and pack it with its description. Returns the path of the FMU."""
    version = 3 if 'fmiVersion="3' in description else 2
    called = (fmpy.fmi3 if version == 3 else fmpy.fmi2).__file__  # FMPy requires all functions that it names
    names = set(re.findall(rf"\bfmi{version}[A-Z]\w+", Path(called).read_text()))
    unused = [word for word in sorted(names) if f"{word}(" not in source]
    code, library = folder / f"{name}.c", folder / f"{name}.so"
    code.write_text(source + "\n".join(f"int {word}(void) {{ return 0; }}" for word in unused))
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", *options, "-o", library, code], check=True)
    with zipfile.ZipFile(folder / f"{name}.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", description)
        platform = fmpy.platform_tuple if version == 3 else fmpy.platform
        archive.write(library, f"binaries/{platform}/spring.so")
    return str(folder / f"{name}.fmu")


def repack(file, other, description):
    """Pack the content of an FMU with another description. Returns the path of the new FMU."""
    with zipfile.ZipFile(file) as source, zipfile.ZipFile(other, "w") as archive:
        for name in source.namelist():
            archive.writestr(name, description if name == "modelDescription.xml" else source.read(name))
    return str(other)

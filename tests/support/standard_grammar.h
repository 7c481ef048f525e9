#pragma once

/// The elements of the standards, one or more lines each:
///   Type "(" attributes ")" "{" content "}"
/// An attribute is name:type, followed by "!" if it is required; "@any" permits all others. A type is one of
/// standard_validator.cpp; "*" after it means a list, words are separated by "|". Content is a regular expression of elements
/// with ? * + | and parentheses. An element is Name, or Name=Type if the type has another name; "any" is any content, not
/// checked further, "text" is text and any content. An element without "{…}" is empty.
namespace cotwin::testing {

/// FMI 2.0.4, clauses 2.2, 3.3 and 4.3.
inline constexpr const char* kFmi2Grammar = R"(
fmiModelDescription(fmiVersion:2.0! modelName:string! guid:string! description:string author:string version:string
    copyright:string license:string generationTool:string generationDateAndTime:dateTime
    variableNamingConvention:flat|structured numberOfEventIndicators:uint) {
  ModelExchange? CoSimulation? (ModelExchange? CoSimulation?)? UnitDefinitions? TypeDefinitions? LogCategories?
  DefaultExperiment? VendorAnnotations=Annotations? ModelVariables ModelStructure }
ModelExchange(modelIdentifier:string! needsExecutionTool:bool completedIntegratorStepNotNeeded:bool
    canBeInstantiatedOnlyOncePerProcess:bool canNotUseMemoryManagementFunctions:bool canGetAndSetFMUstate:bool
    canSerializeFMUstate:bool providesDirectionalDerivative:bool) { SourceFiles? }
CoSimulation(modelIdentifier:string! needsExecutionTool:bool canHandleVariableCommunicationStepSize:bool
    canInterpolateInputs:bool maxOutputDerivativeOrder:uint canRunAsynchronuously:bool
    canBeInstantiatedOnlyOncePerProcess:bool canNotUseMemoryManagementFunctions:bool canGetAndSetFMUstate:bool
    canSerializeFMUstate:bool providesDirectionalDerivative:bool) { SourceFiles? }
SourceFiles() { File+ }
File(name:string!)
UnitDefinitions() { Unit+ }
Unit(name:string!) { BaseUnit? DisplayUnit* }
BaseUnit(kg:int m:int s:int A:int K:int mol:int cd:int rad:int factor:double offset:double)
DisplayUnit(name:string! factor:double offset:double)
TypeDefinitions() { SimpleType+ }
SimpleType(name:string! description:string) {
  Real=RealType | Integer=IntegerType | Boolean=AnyType | String=AnyType | Enumeration=EnumerationType }
AnyType(@any) { text }
RealType(quantity:string unit:string displayUnit:string relativeQuantity:bool min:double max:double nominal:double
    unbounded:bool)
IntegerType(quantity:string min:int max:int)
EnumerationType(quantity:string) { Item+ }
Item(name:string! value:int! description:string)
LogCategories() { Category+ }
Category(name:string! description:string)
DefaultExperiment(startTime:double stopTime:double tolerance:double stepSize:double)
Annotations() { Tool+ }
Tool(name:string!) { any? }
ModelVariables() { ScalarVariable+ }
ScalarVariable(name:string! valueReference:uint! description:string
    causality:parameter|calculatedParameter|input|output|local|independent
    variability:constant|fixed|tunable|discrete|continuous initial:exact|approx|calculated
    canHandleMultipleSetPerTimeInstant:bool) { (Real | Integer | Boolean | String | Enumeration) Annotations? }
Real(declaredType:string quantity:string unit:string displayUnit:string relativeQuantity:bool min:double max:double
    nominal:double unbounded:bool start:double derivative:uint reinit:bool)
Integer(declaredType:string quantity:string min:int max:int start:int)
Boolean(declaredType:string start:bool)
String(declaredType:string start:string)
Enumeration(declaredType:string! quantity:string min:int max:int start:int)
ModelStructure() { Outputs=Unknowns? Derivatives=Unknowns? InitialUnknowns=Unknowns? }
Unknowns() { Unknown+ }
Unknown(index:uint! dependencies:uint* dependenciesKind:dependent|constant|fixed|tunable|discrete*)
)";

/// FMI 3.0.2, clauses 2.4, 3.3, 4.3 and 5.3.
inline constexpr const char* kFmi3Grammar = R"(
fmiModelDescription(fmiVersion:fmi3version! modelName:string! instantiationToken:string! description:string author:string
    version:string copyright:string license:string generationTool:string generationDateAndTime:dateTime
    variableNamingConvention:flat|structured) {
  ModelExchange? CoSimulation? ScheduledExecution? UnitDefinitions? TypeDefinitions? LogCategories? DefaultExperiment?
  ModelVariables ModelStructure Annotations? }
ModelExchange(modelIdentifier:string! needsExecutionTool:bool canBeInstantiatedOnlyOncePerProcess:bool
    canGetAndSetFMUState:bool canSerializeFMUState:bool providesDirectionalDerivatives:bool providesAdjointDerivatives:bool
    providesPerElementDependencies:bool needsCompletedIntegratorStep:bool providesEvaluateDiscreteStates:bool @any) {
  Annotations? }
CoSimulation(modelIdentifier:string! needsExecutionTool:bool canBeInstantiatedOnlyOncePerProcess:bool
    canGetAndSetFMUState:bool canSerializeFMUState:bool providesDirectionalDerivatives:bool providesAdjointDerivatives:bool
    providesPerElementDependencies:bool canHandleVariableCommunicationStepSize:bool fixedInternalStepSize:double
    maxOutputDerivativeOrder:uint recommendedIntermediateInputSmoothness:int providesIntermediateUpdate:bool
    mightReturnEarlyFromDoStep:bool canReturnEarlyAfterIntermediateUpdate:bool hasEventMode:bool
    providesEvaluateDiscreteStates:bool @any) { Annotations? }
ScheduledExecution(modelIdentifier:string! needsExecutionTool:bool canBeInstantiatedOnlyOncePerProcess:bool
    canGetAndSetFMUState:bool canSerializeFMUState:bool providesDirectionalDerivatives:bool providesAdjointDerivatives:bool
    providesPerElementDependencies:bool @any) { Annotations? }
UnitDefinitions() { Unit+ }
Unit(name:string!) { BaseUnit? DisplayUnit* Annotations? }
BaseUnit(kg:int m:int s:int A:int K:int mol:int cd:int rad:int factor:double offset:double)
DisplayUnit(name:string! factor:double offset:double inverse:bool) { Annotations? }
TypeDefinitions() { (Float32Type | Float64Type | Int8Type | UInt8Type | Int16Type | UInt16Type | Int32Type | UInt32Type |
  Int64Type | UInt64Type | BooleanType | StringType=BooleanType | BinaryType | EnumerationType | ClockType)+ }
Float32Type(name:string! description:string quantity:string unit:string displayUnit:string relativeQuantity:bool
    unbounded:bool min:float max:float nominal:float) { Annotations? }
Float64Type(name:string! description:string quantity:string unit:string displayUnit:string relativeQuantity:bool
    unbounded:bool min:double max:double nominal:double) { Annotations? }
Int8Type(name:string! description:string quantity:string min:byte max:byte) { Annotations? }
UInt8Type(name:string! description:string quantity:string min:ubyte max:ubyte) { Annotations? }
Int16Type(name:string! description:string quantity:string min:short max:short) { Annotations? }
UInt16Type(name:string! description:string quantity:string min:ushort max:ushort) { Annotations? }
Int32Type(name:string! description:string quantity:string min:int max:int) { Annotations? }
UInt32Type(name:string! description:string quantity:string min:uint max:uint) { Annotations? }
Int64Type(name:string! description:string quantity:string min:long max:long) { Annotations? }
UInt64Type(name:string! description:string quantity:string min:ulong max:ulong) { Annotations? }
BooleanType(name:string! description:string) { Annotations? }
BinaryType(name:string! description:string mimeType:string maxSize:natural) { Annotations? }
EnumerationType(name:string! description:string quantity:string min:long max:long) { Annotations? Item+ }
Item(name:string! value:long! description:string) { Annotations? }
ClockType(name:string! description:string canBeDeactivated:bool priority:uint
    intervalVariability:constant|fixed|tunable|changing|countdown|triggered! intervalDecimal:double shiftDecimal:double
    supportsFraction:bool resolution:ulong intervalCounter:ulong shiftCounter:ulong) { Annotations? }
LogCategories() { Category+ }
Category(name:string! description:string) { Annotations? }
DefaultExperiment(startTime:double stopTime:double tolerance:double stepSize:double) { Annotations? }
Annotations() { Annotation+ }
Annotation(type:string!) { text }
ModelVariables() { (Float32 | Float64 | Int8 | UInt8 | Int16 | UInt16 | Int32 | UInt32 | Int64 | UInt64 | Boolean | String |
  Binary | Enumeration | Clock)+ }
Float32(VARIABLE INITIAL declaredType:string quantity:string unit:string displayUnit:string relativeQuantity:bool
    unbounded:bool min:float max:float nominal:float start:float* derivative:uint reinit:bool) {
  Annotations? Dimension* Alias=FloatAlias* }
Float64(VARIABLE INITIAL declaredType:string quantity:string unit:string displayUnit:string relativeQuantity:bool
    unbounded:bool min:double max:double nominal:double start:double* derivative:uint reinit:bool) {
  Annotations? Dimension* Alias=FloatAlias* }
Int8(VARIABLE INITIAL declaredType:string quantity:string min:byte max:byte start:byte*) { Annotations? Dimension* Alias* }
UInt8(VARIABLE INITIAL declaredType:string quantity:string min:ubyte max:ubyte start:ubyte*) { Annotations? Dimension* Alias* }
Int16(VARIABLE INITIAL declaredType:string quantity:string min:short max:short start:short*) { Annotations? Dimension* Alias* }
UInt16(VARIABLE INITIAL declaredType:string quantity:string min:ushort max:ushort start:ushort*) {
  Annotations? Dimension* Alias* }
Int32(VARIABLE INITIAL declaredType:string quantity:string min:int max:int start:int*) { Annotations? Dimension* Alias* }
UInt32(VARIABLE INITIAL declaredType:string quantity:string min:uint max:uint start:uint*) { Annotations? Dimension* Alias* }
Int64(VARIABLE INITIAL declaredType:string quantity:string min:long max:long start:long*) { Annotations? Dimension* Alias* }
UInt64(VARIABLE INITIAL declaredType:string quantity:string min:ulong max:ulong start:ulong*) {
  Annotations? Dimension* Alias* }
Boolean(VARIABLE INITIAL declaredType:string start:bool*) { Annotations? Dimension* Alias* }
String(VARIABLE INITIAL declaredType:string) { Annotations? Dimension* Start=TextStart* Alias* }
Binary(VARIABLE INITIAL declaredType:string mimeType:string maxSize:natural) {
  Annotations? Dimension* Start=BinaryStart* Alias* }
Enumeration(VARIABLE INITIAL declaredType:string! quantity:string min:long max:long start:long*) {
  Annotations? Dimension* Alias* }
Clock(NAMED declaredType:string canBeDeactivated:bool priority:uint
    intervalVariability:constant|fixed|tunable|changing|countdown|triggered! intervalDecimal:double shiftDecimal:double
    supportsFraction:bool resolution:ulong intervalCounter:ulong shiftCounter:ulong) { Annotations? Alias* }
Dimension(start:ulong valueReference:uint)
Alias(name:string! description:string)
FloatAlias(name:string! description:string displayUnit:string)
TextStart(value:string)
BinaryStart(value:hex)
ModelStructure() { Output=Unknown* ContinuousStateDerivative=Unknown* ClockedState=Unknown* InitialUnknown=Unknown*
  EventIndicator=Unknown* }
Unknown(valueReference:uint! dependencies:uint* dependenciesKind:dependent|constant|fixed|tunable|discrete*) { Annotations? }
)";

/// Replacements for VARIABLE, INITIAL and NAMED above.
inline constexpr const char* kFmi3Named = R"( name:string! valueReference:uint! description:string
    causality:parameter|calculatedParameter|input|output|local|independent|structuralParameter
    variability:constant|fixed|tunable|discrete|continuous canHandleMultipleSetPerTimeInstant:bool clocks:uint* )";
inline constexpr const char* kFmi3Variable = R"( NAMED intermediateUpdate:bool previous:uint )";
inline constexpr const char* kFmi3Initial = R"( initial:exact|approx|calculated )";

/// SSP 1.0, clause 5.2: common elements of all its documents.
inline constexpr const char* kSspCommonGrammar = R"(
Enumerations() { Enumeration=EnumerationType+ }
EnumerationType(BASE name:string!) { Item+ Annotations? }
Item(name:string! value:int!)
Units() { Unit+ }
Unit(BASE name:string!) { BaseUnit Annotations? }
BaseUnit(kg:int m:int s:int A:int K:int mol:int cd:int rad:int factor:double offset:double)
Annotations() { Annotation+ }
Annotation(type:string!) { any? }
Empty()
)";
inline constexpr const char* kSspBase = R"( id:id description:string )";
inline constexpr const char* kSspTop = R"( author:string fileversion:string copyright:string license:string
    generationTool:string generationDateAndTime:dateTime )";

/// SSP 1.0, clause 5.3.
inline constexpr const char* kSsdGrammar = R"(
SystemStructureDescription(BASE TOP version:ssp1version! name:string!) {
  System Enumerations? Units? DefaultExperiment? Annotations? }
System(BASE name:nonempty!) { Connectors? ElementGeometry? ParameterBindings? Elements? Connections? SignalDictionaries?
  SystemGeometry=Rectangle? GraphicalElements? Annotations? }
Component(BASE name:nonempty! type:string source:uri! implementation:any|ModelExchange|CoSimulation) {
  Connectors? ElementGeometry? ParameterBindings? Annotations? }
SignalDictionaryReference(BASE name:nonempty! dictionary:string!) {
  Connectors? ElementGeometry? ParameterBindings? Annotations? }
Elements() { (Component | SignalDictionaryReference | System)+ }
Connectors() { Connector+ }
Connector(BASE name:string! kind:input|output|parameter|calculatedParameter|inout!) {
  (c:Real=RealPort | c:Integer=Empty | c:Boolean=Empty | c:String=Empty | c:Enumeration=EnumerationPort | c:Binary=BinaryPort)?
  ConnectorGeometry=Point? Annotations? }
RealPort(unit:string)
EnumerationPort(name:string!)
BinaryPort(mime-type:string)
Point(x:double! y:double!)
Rectangle(x1:double! y1:double! x2:double! y2:double!)
ElementGeometry(x1:double! y1:double! x2:double! y2:double! rotation:double iconSource:uri iconRotation:double iconFlip:bool
    iconFixedAspectRatio:bool)
Connections() { Connection+ }
Connection(BASE startElement:string startConnector:string! endElement:string endConnector:string!
    suppressUnitConversion:bool) {
  (c:LinearTransformation | c:BooleanMappingTransformation=BooleanMap | c:IntegerMappingTransformation=IntegerMap |
   c:EnumerationMappingTransformation=EnumerationMap)? ConnectionGeometry? Annotations? }
LinearTransformation(factor:double offset:double)
BooleanMap() { c:MapEntry=BooleanEntry+ }
BooleanEntry(source:bool! target:bool!)
IntegerMap() { c:MapEntry=IntegerEntry+ }
IntegerEntry(source:int! target:int!)
EnumerationMap() { c:MapEntry=EnumerationEntry+ }
EnumerationEntry(source:string! target:string!)
ConnectionGeometry(pointsX:double*! pointsY:double*!)
SignalDictionaries() { SignalDictionary+ }
SignalDictionary(BASE type:string source:uri name:string!) { any* }
GraphicalElements() { Note+ }
Note(x1:double! y1:double! x2:double! y2:double! text:string!)
ParameterBindings() { ParameterBinding+ }
ParameterBinding(BASE type:string source:uri sourceBase:SSD|component prefix:string) {
  ParameterValues? ParameterMapping? Annotations? }
ParameterValues() { any* }
ParameterMapping(BASE type:string source:uri sourceBase:SSD|component) { any* }
DefaultExperiment(startTime:double stopTime:double) { Annotations? }
)";

/// SSP 1.0, clause 5.5.
inline constexpr const char* kSsvGrammar = R"(
ParameterSet(BASE TOP version:ssp1version! name:string!) { Parameters Enumerations? Units? Annotations? }
Parameters() { Parameter* }
Parameter(BASE name:string!) { (Real | Integer | Boolean | String | Enumeration | Binary) Annotations? }
Real(value:double! unit:string)
Integer(value:int!)
Boolean(value:bool!)
String(value:string!)
Enumeration(value:string! name:string)
Binary(mime-type:string value:hex!)
)";

}  // namespace cotwin::testing
